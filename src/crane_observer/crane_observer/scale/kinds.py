"""The kinds of states that each joint has in a `LoadFilter`."""

ZERO, SLOW, DRY, VISCOUS, STICK, CARRIED, PLACE, CRAWL = range(8)
KINDS = 8
