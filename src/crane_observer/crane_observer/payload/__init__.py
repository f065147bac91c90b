"""The load at the tip from pressures and positions, at rest and in motion, lift by lift."""
