"""What all of it comes to: a verdict and its reason."""
