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
from scipy.special import log_ndtr

from crane_observer.scale.doubt import ModelDoubt
from crane_observer.scale.filter import TARE, Balanced, LoadFilter
from crane_observer.scale.weighing import TipLoad, load_of

LIKELIER = 10.0  # logarithm of how much better another load must foretell than the same load
SELDOM = math.log(100.0)  # a load comes or goes with one window of so many, of a crane at work
LEADING = 2  # windows in succession: a single one may be odd
CERTAIN = 3.0  # standard deviations, by which its load must differ from that before
AS_SURE = 2.0  # times the standard deviation of the same load, with which another that is no
# other one takes its place: the same, but with errors of the model that foretell better
OTHERS = 24  # at most; the least likely goes
NEW = 12  # of these, which have had no time to become likely
LIGHTEST = 10.0  # kg that may be missing at the tip, of what the model has there
OVERLAP = 2  # windows that hold samples of a moment: some of before, some of after a change


@dataclass
class OtherLoad:
    """A load that may have come at a time [s]; `ahead` by so much of the same load (logarithm)."""

    since: float
    filter: LoadFilter
    windows: int = 0
    ahead: float = 0.0
    leading: int = 0  # windows in succession by which it was far ahead
    seldom: float = SELDOM  # logarithm of how seldom one comes; 0 where one has come

    @property
    def load(self) -> TipLoad:
        """What it says."""
        return load_of(self.filter.x, self.filter.P)

    @property
    def likelihood(self) -> float:
        """How likely it is, beside the same load (logarithm): nothing hangs there by less than
        nothing.
        """
        return self.ahead + possible(self.filter)

    def differs(self, same: TipLoad) -> bool:
        """Whether it is another load, and not the `same` with other errors beside it."""
        load = self.load
        return abs(load.mass - same.mass) > CERTAIN * load.deviation

    def as_sure(self, same: TipLoad) -> bool:
        """Whether it is known about as well as the `same`."""
        return self.load.deviation < AS_SURE * same.deviation

    def beside(self, chosen: "OtherLoad") -> "OtherLoad":
        """The same, where `chosen` is what hangs there: it may have come later than it seems."""
        return replace(self, ahead=self.ahead - chosen.ahead, leading=0, seldom=0.0)

    def add(self, window: Balanced, same: float) -> None:
        """One more window, of which the `same` load was so likely; those that overlap its beginning
        tell it nothing.
        """
        self.windows += 1
        if self.windows <= OVERLAP:
            self.filter.begin(window)
        else:
            self.ahead += self.filter.take(window) - same


def possible(one: LoadFilter) -> float:
    """Logarithm of how likely it is that what hangs there weighs something."""
    load = load_of(one.x, one.P)
    hung = load.mass + float(one.x[TARE]) + LIGHTEST
    return float(log_ndtr(hung / math.hypot(load.deviation, math.sqrt(one.P[TARE, TARE]))))


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
    def load(self) -> TipLoad:
        """The same load, and others that it may surely be instead, each as likely as it foretells;
        those that are as likely as what would be believed count as much as the same load.
        """
        same = load_of(self.filter.x, self.filter.P)
        doubted = [one for one in self._others if one.differs(same)]
        believed = possible(self.filter)
        ahead = [min(one.likelihood - believed - one.seldom, 0.0) for one in doubted]
        share = np.exp([0.0, *ahead])
        share /= share.sum()
        loads = [same, *(one.load for one in doubted)]
        masses = np.array([one.mass for one in loads])
        variances = np.array([one.deviation**2 for one in loads])
        mean = float(share @ masses)
        variance = float(share @ (variances + (masses - mean) ** 2))
        return same._replace(mass=mean, deviation=math.sqrt(variance))

    def add(self, time: float, window: Balanced) -> bool:
        """One more window; whether it shows that there is another load."""
        other = self.filter.copy()
        other.another_load()
        self._others.append(OtherLoad(time, other))
        same = self.filter.take(window)
        for one in self._others:
            one.add(window, same)
        enough = possible(self.filter) + LIKELIER
        for one in self._others:
            one.leading = one.leading + 1 if one.likelihood > enough else 0
        best = max(self._others, key=lambda one: one.likelihood)
        believed = load_of(self.filter.x, self.filter.P)
        changed = best.differs(believed)
        if best.leading >= LEADING and (changed or best.as_sure(believed)):
            self.since = best.since if changed else self.since
            self.filter = best.filter
            self._others = [one.beside(best) for one in self._others if one.since > best.since]
            return changed
        if len(self._others) > OTHERS:
            self._others.remove(min(self._others[:-NEW], key=lambda one: one.likelihood))
        return False
