"""From recordings to the records that a model is evaluated on."""
