"""The hydraulics as physics: valves, chambers and supply, and the crane moved by its commands."""
