"""When a load comes or goes: the same load against others that may have come with each window.

With each window another load begins, of which nothing is known while everything else is as it
was. All take every window that follows; where one of them foretells them far better than the same
load does, it is what hangs there since it began; those that began later stay in question, because
errors of the model before a change let it seem older than it is. What else may have changed,
friction and slow errors of the pistons' forces, is in the states of all.
"""

import math
from dataclasses import dataclass, replace

import numpy as np

from crane_model.array import Array
from crane_observer.scale.doubt import ModelDoubt
from crane_observer.scale.filter import MASS, MOMENT, Balanced, LoadFilter

LIKELIER = 10.0  # logarithm of how much better another load must foretell than the same load
LEADING = 2  # windows in succession: a single one may be odd
CERTAIN = 3.0  # standard deviations, by which its load must differ from that before
OTHERS = 24  # at most; the least likely goes
OVERLAP = 2  # windows that hold samples of a moment: some of before, some of after a change
TAIL = 4.0  # degrees of freedom of Student's t: a window that nothing explains decides little


@dataclass
class OtherLoad:
    """A load that may have come at a time [s]; `ahead` by so much of the same load (logarithm)."""

    since: float
    filter: LoadFilter
    windows: int = 0
    ahead: float = 0.0
    leading: int = 0  # windows in succession by which it was far ahead

    def differs(self, same: LoadFilter) -> bool:
        """Whether it is another load, and not the `same` with other errors beside it."""
        apart = abs(float(self.filter.x[MASS] - same.x[MASS]))
        return apart > CERTAIN * math.sqrt(float(self.filter.P[MASS, MASS]))

    def beside(self, chosen: "OtherLoad") -> "OtherLoad":
        """The same, where `chosen` is what hangs there: it may have come later than it seems."""
        return replace(self, ahead=self.ahead - chosen.ahead, leading=0)

    def add(self, window: Balanced, same: float) -> None:
        """One more window, of which the `same` load was so likely; those that overlap its beginning
        tell it nothing.
        """
        self.windows += 1
        if self.windows <= OVERLAP:
            self.filter.begin(window)
        else:
            self.ahead += take(self.filter, window) - same
            self.leading = self.leading + 1 if self.ahead > LIKELIER else 0


class Changes:
    """A filter that is told when there is another load."""

    def __init__(self, doubt: ModelDoubt, joints: int):
        self.filter = LoadFilter(doubt, joints)
        self.since = -math.inf
        self._others: list[OtherLoad] = []

    def tare(self) -> None:
        """See `LoadFilter`."""
        self.filter.tare()
        self._others = []

    @property
    def mixture(self) -> tuple[Array, Array]:
        """Mean (2,) and covariance (2, 2) of mass and moment: of the same load, and of others that
        it may surely be instead, each as likely as it foretells; those that are as likely as what
        would be believed count as much as the same load.
        """
        doubted = [one for one in self._others if one.differs(self.filter)]
        ahead = np.array([0.0, *(min(one.ahead, LIKELIER) - LIKELIER for one in doubted)])
        share = np.exp(ahead) / np.exp(ahead).sum()
        filters = [self.filter, *(one.filter for one in doubted)]
        at = [MASS, MOMENT]
        means = np.array([one.x[at] for one in filters])
        mean = share @ means
        away = means - mean
        spread = np.array([one.P[np.ix_(at, at)] for one in filters])
        return mean, np.einsum("k,kij->ij", share, spread) + (share * away.T) @ away

    def add(self, time: float, window: Balanced) -> bool:
        """One more window; whether it shows that there is another load."""
        other = self.filter.copy()
        other.another_load()
        self._others.append(OtherLoad(time, other))
        same = take(self.filter, window)
        for one in self._others:
            one.add(window, same)
        best = max(self._others, key=lambda one: one.ahead)
        if best.leading >= LEADING and best.differs(self.filter):
            self.since, self.filter = best.since, best.filter
            self._others = [one.beside(best) for one in self._others if one.since > best.since]
            return True
        if len(self._others) > OTHERS:
            self._others.remove(min(self._others, key=lambda one: one.ahead))
        return False


def take(one: LoadFilter, window: Balanced) -> float:
    """All that a window tells; how likely it was (logarithm, but for a constant)."""
    one.begin(window)
    H, innovation, variance = one.innovation(window)
    spread: Array = H @ one.P @ H.T + np.diag(variance)
    away = float(innovation @ np.linalg.solve(spread, innovation))
    one.correct(H, innovation, variance)
    tail = 0.5 * (TAIL + len(innovation)) * math.log1p(away / TAIL)
    return -tail - 0.5 * float(np.linalg.slogdet(spread)[1])
