"""What may have hung at the tip, one load after the other: several histories side by side.

What the pressures say of one load they may say of friction that grows with it, too, for as long as
it hangs there; only what comes later tells. So a load that is not noticed, and yet nearly as likely
as the same load, becomes a history of its own: with its own friction, and with changes that follow.
What is told is the mean over all, each as likely as it has foretold all windows.
"""

from crane_observer.scale.changes import Changes
from crane_observer.scale.doubt import ModelDoubt
from crane_observer.scale.filter import Balanced, LoadFilter
from crane_observer.scale.weighing import TipLoad, mean_load

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
