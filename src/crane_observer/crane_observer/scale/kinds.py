"""The kinds of states that each joint has in a `LoadFilter`."""

ZERO, SLOW, DRY, VISCOUS, STICK, CARRIED = range(6)
KINDS = 6
