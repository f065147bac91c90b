"""The load at the tip from pressures and positions: weighed at rest and in motion, lift by lift."""
