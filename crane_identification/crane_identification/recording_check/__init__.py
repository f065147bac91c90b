"""What looks wrong in a recording before anything is fitted to it."""
