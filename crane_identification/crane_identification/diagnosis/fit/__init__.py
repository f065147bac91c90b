"""The model fitted to the recordings, and the rows that they give."""
