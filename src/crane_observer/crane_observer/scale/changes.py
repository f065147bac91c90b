"""When a load comes or goes: the same load against others that may have come with each window.

With each window another load begins, of which nothing is known while everything else is as it
was. All take every window that follows; where one of them foretells them far better than the same
load does, it is what hangs there since it began; those that began later stay in question, because
errors of the model before a change let it seem older than it is. What else may have changed,
friction and slow errors of the pistons' forces, is in the states of all.

All this within one history of what hung there: `crane_observer.scale.changes` has several.
"""

import math
from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from scipy.special import log_ndtr

from crane_observer.scale.filter import TARE, Balanced, LoadFilter, ModelDoubt
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


# What may have hung at the tip, one load after the other: several histories side by side.
#
# What the pressures say of one load they may say of friction that grows with it, too, for as long
# as it hangs there; only what comes later tells. So a load that is not noticed, and yet nearly as
# likely as the same load, becomes a history of its own: with its own friction, and with changes
# that follow. What is told is the mean over all, each as likely as it has foretold all windows.

# Chosen on recordings of `loads`: hard machines of seeds 94500, 128800 and 131900.
MOST = 3  # histories; the least likely goes
PLAUSIBLE = 3.0  # logarithm of how much less likely than the likeliest a new one may be
UNLIKELY = 7.0  # the same, from which on one is given up
AHEAD = 5.0  # by which another must be likelier than what is believed, to be believed
TOGETHER = 1.8  # s that may lie between two changes that are one


class Histories:
    """As a scale sees them: what is believed, and what is told."""

    def __init__(self, doubt: ModelDoubt, joints: int):
        self._each = [Changes(doubt, joints)]

    @property
    def believed(self) -> Changes:
        """The history that is believed."""
        return self._each[0]

    @property
    def filter(self) -> LoadFilter:
        """That of the load that is believed to hang there."""
        return self.believed.filter

    @property
    def since(self) -> float:
        """When that came [s]; -inf: it was there from the beginning."""
        return self.believed.since

    @property
    def load(self) -> TipLoad:
        """The mean over all histories."""
        return mean_load([one.load for one in self._each], [one.likelihood for one in self._each])

    def tare(self) -> None:
        """See `LoadFilter`."""
        for one in self._each:
            one.tare()

    def add(self, time: float, window: Balanced) -> bool:
        """One more window; whether another load is believed to hang there now."""
        believed = self.believed
        changes = [one.add(time, window) for one in self._each]
        changed = changes[0]
        best = max(self._each, key=lambda one: one.likelihood)
        if best.likelihood > believed.likelihood + AHEAD:
            self._each.remove(best)
            self._each.insert(0, best)
            changed |= best.since != believed.since
        self._each = self._kept([*self._each, *self._forks()])
        return changed

    def _forks(self) -> list[Changes]:
        """New histories."""
        known = [one.same for one in self._each]
        likelihoods = sorted((one.likelihood for one in self._each), reverse=True)
        least = max([likelihoods[0] - PLAUSIBLE, *likelihoods[MOST - 1 :]])
        forks = (one.fork(known, least) for one in self._each)
        return [one for one in forks if one is not None]

    def _kept(self, each: list[Changes]) -> list[Changes]:
        """What is believed, and the likeliest of the others."""
        ordered = sorted(each[1:], key=lambda one: one.likelihood, reverse=True)
        least = max(one.likelihood for one in each) - UNLIKELY
        kept = each[:1]
        for one in ordered:
            if one.likelihood > least and not any(_alike(one, other) for other in kept):
                kept.append(one)
        return kept[:MOST]


def _alike(one: Changes, other: Changes) -> bool:
    """Whether the same load came at about the same time in both: one would be counted twice."""
    a, b = one.same, other.same
    together = abs(one.since - other.since) < TOGETHER
    return together and abs(a.mass - b.mass) < min(a.deviation, b.deviation)
