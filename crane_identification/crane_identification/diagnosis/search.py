"""The search for missing effects on one body of evidence: grid, beam, refinement of shapes."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from scipy.optimize import minimize_scalar

from crane_identification.diagnosis.candidates import Family, Option, option, options
from crane_identification.diagnosis.evidence import Evidence
from crane_identification.diagnosis.left_out import left_out
from crane_identification.diagnosis.loads import LOADS, agreeing, load_of, one_each
from crane_identification.diagnosis.projection import (
    Projection,
    project,
    testable,
    whitened_base,
)
from crane_identification.diagnosis.selection import (
    NOTHING,
    Beside,
    Choice,
    larger_sets,
    others,
    solve,
)
from crane_identification.diagnosis.whitening import Whitener, leading, whitener
from crane_model.progress import Progress, silent

EVALUATIONS = 8  # of each shape parameter when it is refined
LARGEST_SET = 6  # effects that are sought together
RIVALS = 4  # best sets of each size whose shapes are refined, so that the race is fair,
CLOSE_SHARE = 0.3  # if they add at least this share of what the best one adds
LARGEST_GAIN = 1e12  # gain; beyond, the search for shapes would lose its numbers
NEIGHBOUR_SHARE = 0.6  # of the way to the next point of the grid, to either side


@dataclass
class Search:
    """Evidence, its whitening and base, and all options beside it, which refinement adds to."""

    evidence: Evidence
    whitener: Whitener
    base: np.ndarray
    projection: Projection
    untestable: dict[Family, str]
    unobservable: dict[Family, str]
    progress: Progress = silent
    _sizes: list[list[Choice]] = field(default_factory=lambda: [[NOTHING]])

    def unexplained(self, choice: Choice) -> np.ndarray:
        """Energy (c,) beyond noise of variance one that a set leaves in each channel."""
        inside = [column for i in choice.options for column in self.projection.members[i]]
        left = self.projection.residual - self.projection.columns[:, inside] @ choice.values
        noise = 1.0 - (self.base**2).sum(axis=1)
        return np.bincount(self._channel, left**2 - noise, self.evidence.channels)

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

    def sets(self, size: int) -> list[Choice]:
        """The best sets of so many effects, best first; their shapes are refined."""
        while len(self._sizes) <= size:
            before = self._sizes[-1]
            known = before[0].gain
            rough = larger_sets(self.projection, before)[:RIVALS]
            for choice in rough:
                if choice.gain - known > CLOSE_SHARE * (rough[0].gain - known):
                    self.refine(choice)
            self._sizes.append(larger_sets(self.projection, before))
            self.progress("search", (len(self._sizes) - 1) / (LARGEST_SET + 1))
        return self._sizes[size]

    def best(self, size: int) -> Choice | None:
        """The best set of so many effects; None if there is none."""
        sets = self.sets(size)
        return self._regrouped(sets[0]) if sets else None

    def number(self, option: Option) -> int:
        """Which of the options of the projection it is."""
        return next(i for i, one in enumerate(self.projection.options) if one is option)

    def added(self, family: Family, shape: dict[str, Any]) -> int:
        """The number of a new option."""
        self.projection = self.projection.joined(self._alone(family, shape))
        return len(self.projection.options) - 1

    def energy_shares(self, number: int) -> np.ndarray:
        """Share (c,) of what an option explains beside the base that each channel carries."""
        power = (self.projection.columns[:, self.projection.members[number]] ** 2).sum(axis=1)
        shares = np.bincount(self._channel, power, self.evidence.channels)
        return shares / max(float(shares.sum()), np.finfo(float).tiny)

    @cached_property
    def _channel(self) -> np.ndarray:
        return self.whitener.channel

    def refine(self, choice: Choice) -> Choice:
        """The set with the shapes of its options refined, which become options of their own.

        Of loads, which recordings have one in common.
        """
        choice = self._regrouped(choice)
        for place in range(len(choice.options)):
            for name in self.projection.options[choice.options[place]].family.shapes:
                choice = self._refined(choice, place, name)
        return choice

    def _regrouped(self, choice: Choice) -> Choice:
        for place, number in enumerate(choice.options):
            if self.projection.options[number].family.parts:
                choice = self._grouped(choice, place)
        return choice

    def _grouped(self, choice: Choice, place: int) -> Choice:
        """The set with one load for each group of recordings that agree, beside its other effects.

        The lightest group has none: masses count from it. More loads than that would gain more.
        """
        family = self.projection.options[choice.options[place]].family
        each = self._alone(family, {LOADS: one_each(self.evidence)})
        inside = [int(c) for i in others(choice, place) for c in self.projection.members[i]]
        known = leading(self.projection.columns[:, inside], len(inside))
        columns = each.columns * each.scale
        columns = columns - known @ (known.T @ columns)
        residual = self.projection.residual - known @ (known.T @ self.projection.residual)
        values = np.linalg.lstsq(columns, residual, rcond=1e-9)[0]
        variance = max(float(((residual - columns @ values) ** 2).mean()), 1.0)
        groups = agreeing(columns.T @ columns, columns.T @ residual, variance)
        if len(groups) == 1:
            return choice
        shape = {LOADS: tuple(load_of(self.evidence, group) for group in groups[1:])}
        same = [
            number
            for number, one in enumerate(self.projection.options)
            if one.family == family and one.shape == shape
        ]
        numbers = list(choice.options)
        numbers[place] = same[0] if same else self.added(family, shape)
        return solve(self.projection, tuple(numbers)) or choice

    def _refined(self, choice: Choice, place: int, name: str) -> Choice:
        start = self.projection.options[choice.options[place]]
        shape = start.family.shapes[name]
        points = len({one[name] for one in start.family.grid()})
        step, middle = NEIGHBOUR_SHARE / max(points - 1, 1), shape.share(start.shape[name])
        low, high = max(middle - step, 0.0), min(middle + step, 1.0)
        tried: list[tuple[float, Projection]] = []
        beside = Beside(self.projection, others(choice, place))

        def cost(share: float) -> float:
            one = self._alone(start.family, {**start.shape, name: shape.value(float(share))})
            gain = beside.gain(one)
            tried.append((gain, one))
            return -min(max(gain, 0.0), LARGEST_GAIN)

        minimize_scalar(
            cost, bounds=(low, high), method="bounded", options={"maxiter": EVALUATIONS}
        )
        gain, one = max(tried, key=lambda entry: entry[0])
        if gain <= choice.gain:
            return choice
        self.projection = self.projection.joined(one)
        numbers = list(choice.options)
        numbers[place] = len(self.projection.options) - 1
        return solve(self.projection, tuple(numbers)) or choice

    def _alone(self, family: Family, shape: dict[str, Any]) -> Projection:
        """The projection of a single option."""
        return project(
            self.evidence, self.whitener, [option(self.evidence, family, shape)], self.base
        )


def search(evidence: Evidence, wanted: list[Family], progress: Progress = silent) -> Search:
    """The `wanted` candidates beside the model."""
    found, unobservable = options(evidence, wanted, progress)
    white = whitener(evidence, np.concatenate([one.columns for one in found], axis=2))
    base = whitened_base(evidence, white)
    projection = project(evidence, white, found, base)
    good, untestable = testable(projection, evidence, white)
    hidden, whole, part = left_out(evidence, found)
    untestable |= whole
    unobservable |= {family: why for family, why in part.items() if family not in untestable}
    kept = projection.kept(good & ~hidden)
    return Search(evidence, white, base, kept, untestable, unobservable, progress)
