"""Rows of (28) from the instants of the smoother: both sides averaged over the same window.

Φ is nonlinear in the motion, so that smoothing the motion and evaluating Φ do not commute: where
the crane swings on its oil at 2 to 3 Hz, Φ of a motion that was smoothed over 0.4 s is off by some
per cent of the swinging part, always the same way. So the smoother is narrow, Φ is evaluated at
each of its instants, and what remains to be smoothed is smoothed here, Φ and τ alike ("parallel
filtering"): a linear filter on both sides of (28) leaves Θ as it is.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from crane_identification.online.smoother import Smoothed

Sides = Callable[[list[Smoothed]], np.ndarray]
"""Both sides of (28) at n instants: (n, j, p + 1), the columns of Φ and then τ."""


class Row(NamedTuple):
    """A row of each joint at `stamp` [ns] in the middle of its window, which begins at `begin`:
    `columns` (j, p) and `force` (j,), in stretch number `run`.
    """

    stamp: int
    begin: int
    run: int
    columns: np.ndarray
    force: np.ndarray


class Window:
    """A row every `every` instants of the smoother, `step` [ns] apart, on the grid of the clock.

    It averages `half` instants on either side of the row, weighted by cos² (Hann): what is faster
    than a row can show is gone, and acceleration noise with it.
    """

    def __init__(self, sides: Sides, half: int, every: int, step: int):
        self._sides, self._half, self._every, self._step = sides, half, every, step
        weights = np.hanning(2 * half + 3)[1:-1]
        self._weights = weights / weights.sum()
        self._waiting: list[Smoothed] = []
        self._known = np.empty((0, 0, 0))
        self._run = -1

    @property
    def overlap(self) -> float:
        """Spectral density at frequency 0 over that of white noise of the same variance, for the
        average of white noise over these windows.
        """
        return float(1.0 / (self._every * (self._weights**2).sum()))

    def add(self, smoothed: Smoothed) -> Row | None:
        """The row whose window the next instant completes, if it does."""
        if smoothed.run != self._run:
            self._run = smoothed.run
            self._waiting, self._known = [], np.empty((0, 0, 0))
        self._waiting.append(smoothed)
        middle = smoothed.stamp - self._half * self._step
        if middle % (self._every * self._step):
            return None
        found = self._sides(self._waiting)
        self._waiting = []
        if len(self._known):
            found = np.concatenate([self._known, found])
        self._known = found[-len(self._weights) :]
        if len(self._known) < len(self._weights):
            return None
        row = np.tensordot(self._weights, self._known, axes=1)
        begin = middle - self._half * self._step
        return Row(middle, begin, self._run, row[:, :-1], row[:, -1])
