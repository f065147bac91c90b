"""The search for missing effects in one body of evidence: grid, beam, refinement of shapes."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.optimize import minimize_scalar

from crane_identification.diagnosis.candidates import (
    Candidate,
    ShapedCandidate,
    at_shape,
    left_out,
    observed,
)
from crane_identification.diagnosis.evidence import Evidence
from crane_identification.diagnosis.loads import LOADS, agreeing, load_of, one_each
from crane_identification.diagnosis.projection import Projection, project, testable, whitened_base
from crane_identification.diagnosis.selection import (
    NOTHING,
    Beside,
    Subset,
    larger_sets,
    others,
    solve,
)
from crane_identification.diagnosis.whitening import Whitener, leading, whitener
from crane_model.progress import Progress, silent

EVALUATIONS = 8  # of each shape parameter when it is refined
LARGEST_SET = 6  # effects that are sought together
REFINED_SETS = 4  # best sets of each size whose shapes are refined, so that the race is fair,
CLOSE_SHARE = 0.3  # if they add at least this share of what the best one adds
LARGEST_GAIN = 1e12  # gain; beyond, the search for shapes would lose its numbers
NEIGHBOUR_SHARE = 0.6  # of the way to the next point of the grid, to either side


@dataclass(frozen=True)
class Search:
    """Evidence, its whitening and base, and all candidates beside it; `sets` are the best of no
    effect, of one, and so on, each size best first.
    """

    evidence: Evidence
    whitener: Whitener
    base: np.ndarray
    projection: Projection
    untestable: dict[Candidate, str]
    unobservable: dict[Candidate, str]
    sets: tuple[tuple[Subset, ...], ...] = ((NOTHING,),)

    def with_sets(self, larger: Sequence[Subset]) -> "Search":
        """With the best sets of one effect more."""
        return replace(self, sets=(*self.sets, tuple(larger)))

    def joined(self, other: Projection) -> "Search":
        """With the candidates of `other`."""
        return replace(self, projection=self.projection.joined(other))

    def alone(self, candidate: Candidate, shape: dict[str, Any]) -> Projection:
        """The projection of a single candidate."""
        return project(
            self.evidence, self.whitener, [at_shape(self.evidence, candidate, shape)], self.base
        )

    def unexplained(self, subset: Subset) -> np.ndarray:
        """Energy (c,) beyond noise of variance one that a set leaves in each channel."""
        inside = [column for i in subset.numbers for column in self.projection.columns_of[i]]
        left = self.projection.residual - self.projection.columns[:, inside] @ subset.values
        noise = 1.0 - (self.base**2).sum(axis=1)
        return np.bincount(self.whitener.channel, left**2 - noise, self.evidence.channels)

    @property
    def testable_share(self) -> float:
        """Share of the effects that would show beside the model, of those that are observable."""
        tested = {shaped.candidate for shaped in self.projection.candidates}
        return len(tested) / max(len(tested) + len(self.untestable), 1)

    def left_share(self, wanted: Sequence[ShapedCandidate]) -> float:
        """Share of the energy beyond noise that these together leave where they act; 0 for none.

        Noise is an estimate, so that what is left may be a little less than nothing.
        """
        numbers = tuple(self.number(one) for one in wanted)
        subset = solve(self.projection, numbers) if numbers else None
        if subset is None:
            return 0.0
        own = sorted({int(channel) for number in numbers for channel in self.channels(number)})
        before, after = (self.unexplained(one)[own].sum() for one in (NOTHING, subset))
        return float(after / before) if before > 0.0 else 0.0

    def channels(self, number: int) -> np.ndarray:
        """The channels in which a candidate acts: of its joint, and of those that carry it too."""
        return np.flatnonzero(self.projection.candidates[number].columns.any(axis=(0, 2)))

    def number(self, shaped: ShapedCandidate) -> int:
        """Which of the candidates of the projection it is."""
        return next(i for i, one in enumerate(self.projection.candidates) if one is shaped)

    def energy_shares(self, number: int) -> np.ndarray:
        """Share (c,) of what a candidate explains beside the base that each channel carries."""
        power = (self.projection.columns[:, self.projection.columns_of[number]] ** 2).sum(axis=1)
        shares = np.bincount(self.whitener.channel, power, self.evidence.channels)
        return shares / max(float(shares.sum()), np.finfo(float).tiny)


class Race:
    """Runs until the decision is taken; `search` is what it has found so far."""

    def __init__(self, search: Search, progress: Progress = silent) -> None:
        self.search = search
        self._progress = progress

    def sets(self, size: int) -> tuple[Subset, ...]:
        """The best sets of so many effects, best first; their shapes are refined."""
        while len(self.search.sets) <= size:
            before = self.search.sets[-1]
            known = before[0].gain
            rough = larger_sets(self.search.projection, before)[:REFINED_SETS]
            for subset in rough:
                if subset.gain - known > CLOSE_SHARE * (rough[0].gain - known):
                    self.refine(subset)
            self.search = self.search.with_sets(larger_sets(self.search.projection, before))
            self._progress("search", (len(self.search.sets) - 1) / (LARGEST_SET + 1))
        return self.search.sets[size]

    def best(self, size: int) -> Subset | None:
        """The best set of so many effects; None if there is none."""
        sets = self.sets(size)
        return self._regrouped(sets[0]) if sets else None

    def added(self, candidate: Candidate, shape: dict[str, Any]) -> int:
        """The number of a candidate that is added."""
        return self._joined(self.search.alone(candidate, shape))

    def _joined(self, one: Projection) -> int:
        """The number of the single candidate of `one`, now that the search has it."""
        self.search = self.search.joined(one)
        return len(self.search.projection.candidates) - 1

    def refine(self, subset: Subset) -> Subset:
        """The set with the shapes of its candidates refined, at which they are added.

        Of loads, which recordings have one in common.
        """
        subset = self._regrouped(subset)
        for place in range(len(subset.numbers)):
            for name in self.search.projection.candidates[subset.numbers[place]].candidate.shapes:
                subset = self._refined(subset, place, name)
        return subset

    def _regrouped(self, subset: Subset) -> Subset:
        for place, number in enumerate(subset.numbers):
            if self.search.projection.candidates[number].candidate.parts:
                subset = self._grouped(subset, place)
        return subset

    def _grouped(self, subset: Subset, place: int) -> Subset:
        """The set with one load for each group of recordings that agree, beside its other effects.

        The lightest group has none: masses count from it. More loads than that would gain more.
        """
        search, projection = self.search, self.search.projection
        candidate = projection.candidates[subset.numbers[place]].candidate
        each = search.alone(candidate, {LOADS: one_each(search.evidence)})
        inside = [int(c) for i in others(subset, place) for c in projection.columns_of[i]]
        known = leading(projection.columns[:, inside], len(inside))
        columns = each.columns * each.scale
        columns = columns - known @ (known.T @ columns)
        residual = projection.residual - known @ (known.T @ projection.residual)
        values = np.linalg.lstsq(columns, residual, rcond=1e-9)[0]
        variance = max(float(((residual - columns @ values) ** 2).mean()), 1.0)
        groups = agreeing(columns.T @ columns, columns.T @ residual, variance)
        if len(groups) == 1:
            return subset
        shape = {LOADS: tuple(load_of(search.evidence, group) for group in groups[1:])}
        same = [
            number
            for number, one in enumerate(projection.candidates)
            if one.candidate == candidate and one.shape == shape
        ]
        numbers = list(subset.numbers)
        numbers[place] = same[0] if same else self.added(candidate, shape)
        return solve(self.search.projection, tuple(numbers)) or subset

    def _refined(self, subset: Subset, place: int, name: str) -> Subset:
        search = self.search
        start = search.projection.candidates[subset.numbers[place]]
        shape = start.candidate.shapes[name]
        points = len({one[name] for one in start.candidate.grid()})
        step, middle = NEIGHBOUR_SHARE / max(points - 1, 1), shape.share(start.shape[name])
        low, high = max(middle - step, 0.0), min(middle + step, 1.0)
        tried: list[tuple[float, Projection]] = []
        beside = Beside(search.projection, others(subset, place))

        def cost(share: float) -> float:
            one = search.alone(start.candidate, {**start.shape, name: shape.value(float(share))})
            gain = beside.gain(one)
            tried.append((gain, one))
            return -min(max(gain, 0.0), LARGEST_GAIN)

        minimize_scalar(
            cost, bounds=(low, high), method="bounded", options={"maxiter": EVALUATIONS}
        )
        gain, one = max(tried, key=lambda entry: entry[0])
        if gain <= subset.gain:
            return subset
        numbers = list(subset.numbers)
        numbers[place] = self._joined(one)
        return solve(self.search.projection, tuple(numbers)) or subset


def search(evidence: Evidence, wanted: list[Candidate], progress: Progress = silent) -> Search:
    """The `wanted` candidates beside the model, at the shapes of their grids."""
    found, unobservable = observed(evidence, wanted, progress)
    white = whitener(evidence, np.concatenate([one.columns for one in found], axis=2))
    base = whitened_base(evidence, white)
    projection = project(evidence, white, found, base)
    good, untestable = testable(projection, evidence, white)
    hidden, whole, part = left_out(evidence, found)
    untestable |= whole
    unobservable |= {
        candidate: why for candidate, why in part.items() if candidate not in untestable
    }
    kept = projection.kept(good & ~hidden)
    return Search(evidence, white, base, kept, untestable, unobservable)
