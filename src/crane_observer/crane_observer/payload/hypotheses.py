"""When a load comes or goes: hypotheses of what has hung at the tip, one load after another.

With each window another load begins, of which nothing is known while everything else is as it was.
All take every window that follows; if one of them predicts them far better than the same load does,
it is what hangs there since it began; those that began later stay in question, because errors of
the model before a change let it seem older than it is. What else may have changed, friction and
slow errors of the pistons' forces, is in the states of all.

What the pressures say of one load they may say of friction that grows with it, too, for as long as
it hangs there; only what comes later tells. So a load that is not noticed, and yet nearly as likely
as the same load, becomes a hypothesis of its own: with its own friction, and with changes that
follow. The estimate is the mean over all, each as likely as it has predicted all windows.
"""

import math
from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from scipy.special import log_ndtr

from crane_observer.payload.filter import (
    TARE,
    Balanced,
    LoadFilter,
    ModelDoubt,
    TipLoad,
    load_of,
    mean_load,
)
from crane_observer.position.state import MISSING_SHARE

CHANGE_EVIDENCE = 10.0  # logarithm of how much better another load must predict than the same load
SELDOM = math.log(50.0)  # a load comes or goes with one window of so many, of a crane that stands
SELDOM_IN_MOTION = math.log(200.0)  # the same, of one that moves: most grip and let go standing
LEADING_WINDOWS = 2  # in succession: a single one may be odd
CERTAIN = 3.0  # standard deviations, by which its load must differ from that before
AS_SURE = 2.0  # times the standard deviation of the same load, with which another that is no
# other one takes its place: the same, but with errors of the model that predict better
HYPOTHESES_APART = 2.0  # standard deviations, by which the load of another hypothesis must differ
MOST_CANDIDATES = 24  # the least likely goes
NEW_WINDOWS = 12  # or candidates: these have had no time to become likely
OVERLAP = 2  # windows that hold samples of a moment: some of before, some of after a change

# Chosen on recordings of `loads`: hard machines of seeds 94500, 128800 and 131900.
MOST_HYPOTHESES = 3  # the least likely goes
PLAUSIBLE = 3.0  # logarithm of how much less likely than the likeliest a new one may be
UNLIKELY = 7.0  # the same, from which on one is given up
AHEAD = 5.0  # by which another must be likelier than what is believed, to be believed
TOGETHER = 1.8  # s that may lie between two changes that are one


@dataclass(eq=False)
class LoadCandidate:
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

    def beside(self, chosen: "LoadCandidate") -> "LoadCandidate":
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


def possible(load_filter: LoadFilter) -> float:
    """Logarithm of how likely it is that what hangs there weighs something."""
    x, P = load_filter.x, load_filter.P
    load = load_of(x, P)
    hung = load.mass + float(x[TARE]) + MISSING_SHARE * load_filter.doubt.unknown
    return float(log_ndtr(hung / math.hypot(load.deviation, math.sqrt(P[TARE, TARE]))))


class LoadHypothesis:
    """What hung at the tip: a filter that is told when there is another load."""

    def __init__(self, doubt: ModelDoubt, joints: int):
        self.filter = LoadFilter(doubt, joints)
        self.since = -math.inf
        self.evidence = 0.0  # logarithm of how likely all windows were, and all changes
        self._candidates: list[LoadCandidate] = []

    @property
    def likelihood(self) -> float:
        """How likely this hypothesis is, beside others (logarithm)."""
        return self.evidence + possible(self.filter)

    @property
    def same(self) -> TipLoad:
        """The load that has hung there since the last change."""
        return load_of(self.filter.x, self.filter.P)

    @property
    def load(self) -> TipLoad:
        """The same load, and others that it may surely be instead, each as likely as it predicts;
        those that are as likely as what would be believed count as much as the same load.
        """
        same = self.same
        doubted = [candidate for candidate in self._candidates if candidate.differs(same)]
        believed = possible(self.filter)
        ahead = [min(load.likelihood - believed - load.seldom, 0.0) for load in doubted]
        return mean_load([same, *(candidate.load for candidate in doubted)], [0.0, *ahead])

    def fork(self, known: Sequence[TipLoad], least: float) -> Self | None:
        """The hypothesis in which another load hangs there that is none of the `known`, if one has
        had its time and is likelier than `least` (logarithm). It is as likely as that load is,
        whenever it came, and takes with it all that say the same load.
        """
        candidates = [
            candidate
            for candidate in self._candidates
            if all(candidate.differs(load, HYPOTHESES_APART) for load in known)
        ]
        tried = [candidate for candidate in candidates if candidate.windows > NEW_WINDOWS]
        if not tried:
            return None
        best = max(tried, key=self._likelihood)
        alike = [c for c in candidates if not c.differs(best.load, HYPOTHESES_APART)]
        likelihood = float(np.logaddexp.reduce([self._likelihood(load) for load in alike]))
        if likelihood <= least:
            return None
        fork = copy(self)
        fork.filter, fork.since = best.filter, best.since
        fork.evidence = likelihood - possible(best.filter)
        fork._candidates = [load.beside(best) for load in alike if load.since > best.since]
        self._candidates = [load for load in self._candidates if load not in alike]
        return fork

    def _likelihood(self, candidate: LoadCandidate) -> float:
        """Of this hypothesis, if the candidate hangs there now."""
        return self.evidence + candidate.before + candidate.likelihood - candidate.seldom

    def tare(self) -> None:
        self.filter.tare()
        self._candidates = []

    def forget(self) -> None:
        """Nothing is known of the load any more."""
        self.filter.another_load()
        self._candidates = []

    def add(self, time: float, window: Balanced) -> bool:
        """One more window; whether it shows that there is another load."""
        unknown_load = self.filter.copy()
        unknown_load.another_load()
        seldom = SELDOM if window.standing.all() else SELDOM_IN_MOTION
        before = possible(self.filter)
        self._candidates.append(LoadCandidate(time, unknown_load, seldom, before=before))
        same = self.filter.take(window)
        self.evidence += same
        for candidate in self._candidates:
            candidate.add(window, same)
        enough = possible(self.filter) + CHANGE_EVIDENCE
        for candidate in self._candidates:
            candidate.leading = candidate.leading + 1 if candidate.likelihood > enough else 0
        best = max(self._candidates, key=lambda candidate: candidate.likelihood)
        believed = self.same
        changed = best.differs(believed)
        as_sure = best.load.deviation < AS_SURE * believed.deviation
        if best.leading >= LEADING_WINDOWS and (changed or as_sure):
            self.since = best.since if changed else self.since
            self.filter = best.filter
            self.evidence += best.before + best.ahead - best.seldom
            later = [load for load in self._candidates if load.since > best.since]
            self._candidates = [load.beside(best) for load in later]
            return changed
        if len(self._candidates) > MOST_CANDIDATES:
            old = self._candidates[:-NEW_WINDOWS]
            self._candidates.remove(min(old, key=lambda candidate: candidate.likelihood))
        return False


class LoadHypotheses:
    """Several hypotheses side by side: one is believed, and the mean over all is told."""

    def __init__(self, doubt: ModelDoubt, joints: int):
        self._hypotheses = [LoadHypothesis(doubt, joints)]

    @property
    def believed(self) -> LoadHypothesis:
        return self._hypotheses[0]

    @property
    def load(self) -> TipLoad:
        """The mean over all hypotheses."""
        loads = [hypothesis.load for hypothesis in self._hypotheses]
        return mean_load(loads, [hypothesis.likelihood for hypothesis in self._hypotheses])

    def tare(self) -> None:
        for hypothesis in self._hypotheses:
            hypothesis.tare()

    def forget(self) -> None:
        self._hypotheses = [self.believed]
        self.believed.forget()

    def add(self, time: float, window: Balanced) -> bool:
        """One more window; whether another load is believed to hang there now."""
        believed = self.believed
        changed, *_ = [hypothesis.add(time, window) for hypothesis in self._hypotheses]
        best = max(self._hypotheses, key=lambda hypothesis: hypothesis.likelihood)
        if best.likelihood > believed.likelihood + AHEAD:
            self._hypotheses.remove(best)
            self._hypotheses.insert(0, best)
            changed |= best.since != believed.since
        self._hypotheses = self._kept([*self._hypotheses, *self._forks()])
        return changed

    def _forks(self) -> list[LoadHypothesis]:
        known = [hypothesis.same for hypothesis in self._hypotheses]
        likelihoods = sorted((known.likelihood for known in self._hypotheses), reverse=True)
        least = max([likelihoods[0] - PLAUSIBLE, *likelihoods[MOST_HYPOTHESES - 1 :]])
        forks = (hypothesis.fork(known, least) for hypothesis in self._hypotheses)
        return [fork for fork in forks if fork is not None]

    def _kept(self, hypotheses: list[LoadHypothesis]) -> list[LoadHypothesis]:
        """What is believed, and the likeliest of the others."""
        believed, *rest = hypotheses
        least = max(hypothesis.likelihood for hypothesis in hypotheses) - UNLIKELY
        kept = [believed]
        for hypothesis in sorted(rest, key=lambda known: known.likelihood, reverse=True):
            if hypothesis.likelihood > least and not any(_alike(hypothesis, k) for k in kept):
                kept.append(hypothesis)
        return kept[:MOST_HYPOTHESES]


def _alike(first: LoadHypothesis, second: LoadHypothesis) -> bool:
    """Whether the same load came at about the same time in both: one would be counted twice."""
    a, b = first.same, second.same
    together = abs(first.since - second.since) < TOGETHER
    return together and abs(a.mass - b.mass) < min(a.deviation, b.deviation)
