"""From measured positions to velocity and acceleration."""
