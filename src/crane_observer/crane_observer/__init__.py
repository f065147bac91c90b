"""The crane that knows itself: positions without encoders, and the load at the tip."""
