"""Which joints the force balance tells, whatever is believed of them: from what it said lately.

The information about all states, half of it forgotten in some time, with what is known of a model's
errors and nothing of positions and load; a position is observable where this bounds it.
"""

import math

import numpy as np

from crane_model.array import Array, Flags
from crane_observer.position.state import POSITION, StateLayout

MEMORY = 30.0  # s
WIDE = 0.02  # of the range of a joint, one standard deviation, up to which it is observable
HEAVIEST = 200.0  # kg, what may hang at the tip


class Observability:
    """Of one model, whose joints have a `span` (j,) and errors a `spread` (size,)."""

    def __init__(self, layout: StateLayout, span: Array, spread: Array, heaviest: float = HEAVIEST):
        self._layout, self._span = layout, span
        known = spread.copy()
        known[layout.of(POSITION)], known[layout.load] = span, heaviest
        self._prior = np.diag(1.0 / known**2)
        self._information = np.zeros((layout.size, layout.size))

    def add(self, rows: Array, duration: float) -> None:
        """Those of unit variance with slopes `rows` (r, size), `duration` [s] after the last."""
        self._information *= math.exp(-duration / MEMORY)
        self._information += rows.T @ rows

    @property
    def deviation(self) -> Array:
        """(j,) of each position, by the force balance alone."""
        every = np.linalg.inv(self._information + self._prior)
        return np.sqrt(np.diag(every)[self._layout.of(POSITION)])

    @property
    def observable(self) -> Flags:
        """(j,) whether the position of each joint is bounded by it."""
        return np.asarray(self.deviation < WIDE * self._span)
