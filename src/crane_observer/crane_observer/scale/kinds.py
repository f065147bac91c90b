"""The kinds of states that each joint has in a `LoadFilter`."""

ZERO, SLOW, DRY, VISCOUS, STICK = range(5)
KINDS = 5
