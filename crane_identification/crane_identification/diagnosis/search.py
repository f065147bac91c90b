"""What a search for missing effects has found in one body of evidence."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from crane_identification.diagnosis.candidates import Family, Option, option, options
from crane_identification.diagnosis.evidence import Evidence
from crane_identification.diagnosis.left_out import left_out
from crane_identification.diagnosis.projection import (
    Projection,
    project,
    testable,
    whitened_base,
)
from crane_identification.diagnosis.selection import NOTHING, Choice, solve
from crane_identification.diagnosis.whitening import Whitener, whitener
from crane_identification.progress import Progress, silent


@dataclass(frozen=True)
class Search:
    """Evidence, its whitening and base, and all options beside it; `sets` are the best of no
    effect, of one, and so on, each size best first.
    """

    evidence: Evidence
    whitener: Whitener
    base: np.ndarray
    projection: Projection
    untestable: dict[Family, str]
    unobservable: dict[Family, str]
    sets: tuple[tuple[Choice, ...], ...] = ((NOTHING,),)

    def with_sets(self, larger: Sequence[Choice]) -> "Search":
        """With the best sets of one effect more."""
        return replace(self, sets=(*self.sets, tuple(larger)))

    def joined(self, other: Projection) -> "Search":
        """With the options of `other`."""
        return replace(self, projection=self.projection.joined(other))

    def alone(self, family: Family, shape: dict[str, Any]) -> Projection:
        """The projection of a single option."""
        return project(
            self.evidence, self.whitener, [option(self.evidence, family, shape)], self.base
        )

    def unexplained(self, choice: Choice) -> np.ndarray:
        """Energy (c,) beyond noise of variance one that a set leaves in each channel."""
        inside = [column for i in choice.options for column in self.projection.members[i]]
        left = self.projection.residual - self.projection.columns[:, inside] @ choice.values
        noise = 1.0 - (self.base**2).sum(axis=1)
        return np.bincount(self.whitener.channel, left**2 - noise, self.evidence.channels)

    @property
    def testable_share(self) -> float:
        """Share of the effects that would show beside the model, of those that are observable."""
        tested = {option.family for option in self.projection.options}
        return len(tested) / max(len(tested) + len(self.untestable), 1)

    def left_share(self, wanted: Sequence[Option]) -> float:
        """Share of the energy beyond noise that options together leave where they act; 0 for none.

        Noise is an estimate, so that what is left may be a little less than nothing.
        """
        numbers = tuple(self.number(one) for one in wanted)
        choice = solve(self.projection, numbers) if numbers else None
        if choice is None:
            return 0.0
        own = sorted({int(channel) for number in numbers for channel in self.channels(number)})
        before, after = (self.unexplained(one)[own].sum() for one in (NOTHING, choice))
        return float(after / before) if before > 0.0 else 0.0

    def channels(self, number: int) -> np.ndarray:
        """The channels in which an option acts: of its joint, and of those that carry it too."""
        return np.flatnonzero(self.projection.options[number].columns.any(axis=(0, 2)))

    def number(self, option: Option) -> int:
        """Which of the options of the projection it is."""
        return next(i for i, one in enumerate(self.projection.options) if one is option)

    def energy_shares(self, number: int) -> np.ndarray:
        """Share (c,) of what an option explains beside the base that each channel carries."""
        power = (self.projection.columns[:, self.projection.members[number]] ** 2).sum(axis=1)
        shares = np.bincount(self.whitener.channel, power, self.evidence.channels)
        return shares / max(float(shares.sum()), np.finfo(float).tiny)


def search(evidence: Evidence, wanted: list[Family], progress: Progress = silent) -> Search:
    """The `wanted` candidates beside the model, at the shapes of their grids."""
    found, unobservable = options(evidence, wanted, progress)
    white = whitener(evidence, np.concatenate([one.columns for one in found], axis=2))
    base = whitened_base(evidence, white)
    projection = project(evidence, white, found, base)
    good, untestable = testable(projection, evidence, white)
    hidden, whole, part = left_out(evidence, found)
    untestable |= whole
    unobservable |= {family: why for family, why in part.items() if family not in untestable}
    kept = projection.kept(good & ~hidden)
    return Search(evidence, white, base, kept, untestable, unobservable)
