"""Recordings: what was logged, and how it is read."""
