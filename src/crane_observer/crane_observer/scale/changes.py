"""When a load comes or goes: a cumulated sum of surprises, and the windows since it began.

What was weighed since the load must have changed is weighed again without what was known before.
"""

import math

import numpy as np

from crane_model.array import Array
from crane_observer.scale.doubt import ModelDoubt
from crane_observer.scale.filter import MASS, Balanced, LoadFilter

SURPRISE = 6.0  # standard deviations of another load, in the sum over some windows
SLACK = 1.0  # of these, a window, that are no surprise
CERTAIN = 3.0  # standard deviations, by which it must differ from the load before
EXPLAINED = 0.6  # of what surprises, that another load must explain
STRANGE = 6.0  # standard deviations, a window, that nothing explains: it does not count
LONGEST = 20  # windows that are looked back
OVERLAP = 2  # windows that hold samples of a moment: some of before, some of after a change


class Changes:
    """A filter that is told when there is another load."""

    def __init__(self, doubt: ModelDoubt, joints: int):
        self.filter = LoadFilter(doubt, joints)
        self.since = -math.inf
        self._before = self.filter.copy()  # the windows of `_again`
        self._again: list[tuple[float, Balanced]] = []
        self._sum = np.zeros(2)
        self._strange = 0

    def tare(self) -> None:
        """See `LoadFilter`."""
        self.filter.tare()
        self._before, self._again, self._sum = self.filter.copy(), [], np.zeros(2)

    def add(self, time: float, window: Balanced) -> bool:
        """One more window; whether it shows that there is another load."""
        self.filter.begin(window)
        H, innovation, variance = self.filter.innovation(window)
        away, strange = self._surprise(H, innovation, variance)
        self._strange = self._strange + 1 if strange else 0
        if not strange or self._strange > LONGEST:
            self.filter.correct(H, innovation, variance)
        self._sum = np.maximum(self._sum + np.array([away, -away]) - SLACK, 0.0)
        self._again.append((time, window))
        longest = LONGEST if self._sum.any() else 1
        while len(self._again) > longest:
            take(self._before, self._again.pop(0)[1])
        if self._sum.max() < SURPRISE:
            return False
        self._sum = np.minimum(self._sum, SURPRISE)
        other, again = self._before.copy(), self._again
        other.another_load()
        for _, one in again[:OVERLAP]:
            other.begin(one)
        settled = other.copy()
        for _, one in again[OVERLAP:]:
            take(other, one)
        apart = abs(other.x[MASS] - self._before.x[MASS])
        if apart < CERTAIN * math.sqrt(other.P[MASS, MASS]):
            return False  # as well the same load, and something else
        self.since, self.filter = again[0][0], other
        self._before, self._again, self._sum = settled, again[OVERLAP:], np.zeros(2)
        return True

    def _surprise(self, H: Array, innovation: Array, variance: Array) -> tuple[float, bool]:
        """How many standard deviations away another load is, 0 where something else is; and
        whether nothing explains the window.
        """
        load = H[:, MASS]
        spread = H @ self.filter.P @ H.T + np.diag(variance)
        solved = np.linalg.solve(spread, np.stack([load, innovation], axis=1))
        information = float(load @ solved[:, 0])
        if information <= 0.0:
            return 0.0, False
        away = float(load @ solved[:, 1]) / math.sqrt(information)
        whole = float(innovation @ solved[:, 1])
        if away**2 >= EXPLAINED * whole:
            return away, False
        return 0.0, whole > STRANGE**2


def take(one: LoadFilter, window: Balanced) -> None:
    """All that a window tells."""
    one.begin(window)
    one.correct(*one.innovation(window))
