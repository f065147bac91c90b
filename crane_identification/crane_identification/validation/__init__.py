"""How well a model predicts forces and motions that it has not seen."""
