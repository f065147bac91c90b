"""The kinds of states that each joint has in a `LoadFilter`."""

ZERO, SLOW, DRY, VISCOUS, STICK, CARRIED, PLACE = range(7)
KINDS = 7
