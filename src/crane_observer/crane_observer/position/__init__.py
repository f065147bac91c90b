"""Positions and the load at the tip from pressures, commands and the encoders that are left."""
