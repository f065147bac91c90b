"""The search for effects that the model may lack, beside the model."""
