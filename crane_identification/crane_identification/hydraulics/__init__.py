"""The hydraulics identified: valves, oil and supply from valve commands and pressures."""
