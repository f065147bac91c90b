"""Θ and its uncertainty, (28)-(31)."""
