"""When a load comes or goes: the same load against others that may have come with each window.

With each window another load begins, of which nothing is known while everything else is as it
was. All take every window that follows; where one of them foretells them far better than the same
load does, it is what hangs there since it began; those that began later stay in question, because
errors of the model before a change let it seem older than it is. What else may have changed,
friction and slow errors of the pistons' forces, is in the states of all.

All this within one history of what hung there: `crane_observer.scale.histories` has several.
"""

import math
from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from scipy.special import log_ndtr

from crane_observer.scale.doubt import ModelDoubt
from crane_observer.scale.filter import TARE, Balanced, LoadFilter
from crane_observer.scale.weighing import TipLoad, load_of, mean_load

LIKELIER = 10.0  # logarithm of how much better another load must foretell than the same load
SELDOM = math.log(50.0)  # a load comes or goes with one window of so many, of a crane that stands
SELDOM_IN_MOTION = math.log(200.0)  # the same, of one that moves: most grip and let go standing
LEADING = 2  # windows in succession: a single one may be odd
CERTAIN = 3.0  # standard deviations, by which its load must differ from that before
AS_SURE = 2.0  # times the standard deviation of the same load, with which another that is no
# other one takes its place: the same, but with errors of the model that foretell better
APART = 2.0  # standard deviations, by which the load of another history must differ
OTHERS = 24  # at most; the least likely goes
NEW = 12  # windows, or others: these have had no time to become likely
LIGHTEST = 10.0  # kg that may be missing at the tip, of what the model has there
OVERLAP = 2  # windows that hold samples of a moment: some of before, some of after a change


@dataclass(eq=False)
class OtherLoad:
    """A load that may have come at a time [s]; `ahead` by so much of the same load (logarithm)."""

    since: float
    filter: LoadFilter
    seldom: float = SELDOM  # logarithm of how seldom one comes; 0 where one has come
    windows: int = 0
    ahead: float = 0.0
    leading: int = 0  # windows in succession by which it was far ahead
    before: float = 0.0  # logarithm of how likely it was that the load before weighs something

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

    def differs(self, same: TipLoad, deviations: float = CERTAIN) -> bool:
        """Whether it is another load, and not the `same` with other errors beside it."""
        load = self.load
        return abs(load.mass - same.mass) > deviations * load.deviation

    def as_sure(self, same: TipLoad) -> bool:
        """Whether it is known about as well as the `same`."""
        return self.load.deviation < AS_SURE * same.deviation

    def beside(self, chosen: "OtherLoad") -> "OtherLoad":
        """The same, where `chosen` is what hangs there: it may have come later than it seems."""
        ahead, before = self.ahead - chosen.ahead, self.before - chosen.before
        return replace(self, ahead=ahead, before=before, leading=0, seldom=0.0)

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
    """A filter that is told when there is another load: one history of what hung at the tip."""

    def __init__(self, doubt: ModelDoubt, joints: int):
        self.filter = LoadFilter(doubt, joints)
        self.since = -math.inf
        self.evidence = 0.0  # logarithm of how likely all windows were, and all changes
        self._others: list[OtherLoad] = []

    @property
    def likelihood(self) -> float:
        """How likely this history is, beside other ones (logarithm)."""
        return self.evidence + possible(self.filter)

    @property
    def same(self) -> TipLoad:
        """The load that has hung there since the last change."""
        return load_of(self.filter.x, self.filter.P)

    def fork(self, known: Sequence[TipLoad], least: float) -> Self | None:
        """The history in which another load hangs there that is none of the `known`, if one has had
        its time and is likelier than `least` (logarithm). It is as likely as that load is, whenever
        it came, and takes with it all that say the same load.
        """
        others = [one for one in self._others if all(one.differs(load, APART) for load in known)]
        tried = [one for one in others if one.windows > NEW]
        if not tried:
            return None
        best = max(tried, key=self._likelihood)
        alike = [one for one in others if not one.differs(best.load, APART)]
        likelihood = float(np.logaddexp.reduce([self._likelihood(one) for one in alike]))
        if likelihood <= least:
            return None
        fork = copy(self)
        fork.filter, fork.since = best.filter, best.since
        fork.evidence = likelihood - possible(best.filter)
        fork._others = [one.beside(best) for one in alike if one.since > best.since]
        self._others = [one for one in self._others if one not in alike]
        return fork

    def _likelihood(self, one: OtherLoad) -> float:
        """Of this history, if `one` hangs there now."""
        return self.evidence + one.before + one.likelihood - one.seldom

    def tare(self) -> None:
        """See `LoadFilter`."""
        self.filter.tare()
        self._others = []

    @property
    def load(self) -> TipLoad:
        """The same load, and others that it may surely be instead, each as likely as it foretells;
        those that are as likely as what would be believed count as much as the same load.
        """
        same = self.same
        doubted = [one for one in self._others if one.differs(same)]
        believed = possible(self.filter)
        ahead = [min(one.likelihood - believed - one.seldom, 0.0) for one in doubted]
        return mean_load([same, *(one.load for one in doubted)], [0.0, *ahead])

    def add(self, time: float, window: Balanced) -> bool:
        """One more window; whether it shows that there is another load."""
        other = self.filter.copy()
        other.another_load()
        seldom = SELDOM if window.standing.all() else SELDOM_IN_MOTION
        self._others.append(OtherLoad(time, other, seldom, before=possible(self.filter)))
        same = self.filter.take(window)
        self.evidence += same
        for one in self._others:
            one.add(window, same)
        enough = possible(self.filter) + LIKELIER
        for one in self._others:
            one.leading = one.leading + 1 if one.likelihood > enough else 0
        best = max(self._others, key=lambda one: one.likelihood)
        believed = self.same
        changed = best.differs(believed)
        if best.leading >= LEADING and (changed or best.as_sure(believed)):
            self.since = best.since if changed else self.since
            self.filter = best.filter
            self.evidence += best.before + best.ahead - best.seldom
            self._others = [one.beside(best) for one in self._others if one.since > best.since]
            return changed
        if len(self._others) > OTHERS:
            self._others.remove(min(self._others[:-NEW], key=lambda one: one.likelihood))
        return False
