"""Forward selection: a beam over sets of candidates; shapes of the best sets are refined."""

from collections.abc import Collection, Hashable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from scipy.optimize import minimize_scalar

from crane_identification.diagnosis.candidates import (
    LOADS,
    Candidate,
    ShapedCandidate,
    agreeing,
    at_shape,
    load_of,
    one_each,
)
from crane_identification.diagnosis.constants import LARGEST_SET
from crane_identification.diagnosis.evidence import beside, leading
from crane_identification.diagnosis.projection import (
    BEAM,
    NOTHING,
    Base,
    LargerSets,
    Projection,
    Subset,
    constrained,
    larger_sets,
    project,
    solve,
)
from crane_identification.diagnosis.search import Search
from crane_model.progress_bar import Progress, silent

EVALUATIONS = 8  # of each shape parameter when it is refined
REFINED_SETS = 4  # best sets of each size whose shapes are refined, so that the selection is fair,
CLOSE_SHARE = 0.3  # if they add at least this share of what the best one adds
LARGEST_GAIN = 1e12  # gain; beyond, the search for shapes would lose its numbers
NEIGHBOUR_SHARE = 0.6  # of the way to the next point of the grid, to either side
EDGE_SHARE = 0.1  # of that way: a shape that is best so near its end is sought beyond


@dataclass
class ForwardSelection:
    """Runs until the decision is taken; `search` is what it has found so far."""

    search: Search
    progress: Progress = silent
    _known: dict[Hashable, tuple[Base, Projection]] = field(
        default_factory=dict, init=False, repr=False
    )
    _refused: set[Candidate] = field(default_factory=set, init=False, repr=False)
    _larger: LargerSets = field(default_factory=dict, init=False, repr=False)
    _size: int = field(default=0, init=False, repr=False)  # of the sets in `_larger`
    _asked: int = field(default=0, init=False, repr=False)  # candidates that they may hold

    def sets(self, size: int) -> tuple[Subset, ...]:
        """The best sets of so many effects, best first; their shapes are refined."""
        while len(self.search.sets) <= size:
            known = self.search.sets[-1][0].gain
            rough = self._larger_sets()[:REFINED_SETS]
            for subset in rough:
                if subset.gain - known > CLOSE_SHARE * (rough[0].gain - known):
                    self.refine(subset)
            larger = tuple(self._larger_sets()[:BEAM])
            self.search = replace(self.search, sets=(*self.search.sets, larger))
            self.progress("search", (len(self.search.sets) - 1) / (LARGEST_SET + 1))
        return self.search.sets[size]

    def _larger_sets(self) -> list[Subset]:
        """The sets of one effect more, best first; only candidates that are new are asked."""
        search, size = self.search, len(self.search.sets)
        if self._size != size:
            self._size, self._asked, self._larger = size, 0, {}
        more = larger_sets(search.projection, search.sets[-1], self._refused, self._asked)
        self._asked = len(search.projection.candidates)
        for effects, subset in more.items():
            if effects not in self._larger or subset.gain > self._larger[effects].gain:
                self._larger[effects] = subset
        return sorted(self._larger.values(), key=lambda subset: -subset.gain)

    def go_on_from(self, start: Subset) -> None:
        """Sets grow from this one alone from now on; smaller ones are what it begins with."""
        parts = [start.numbers[:count] for count in range(1, len(start.numbers))]
        known = [solve(self.search.projection, part) or NOTHING for part in parts]
        sets = [NOTHING, *known, start] if start.numbers else [NOTHING]
        self._refused.clear()
        self._size = 0
        self.search = replace(self.search, sets=tuple((one,) for one in sets))

    def refuse(self, size: int, candidates: Collection[Candidate]) -> None:
        """Seek sets of `size` effects anew, without these candidates."""
        self._refused |= set(candidates)
        known = self.search.projection.candidates

        def allowed(subset: Subset) -> bool:
            return not self._refused & {known[number].candidate for number in subset.numbers}

        kept = [tuple(filter(allowed, sets)) for sets in self.search.sets[:size]]
        self.search = replace(self.search, sets=tuple(filter(None, kept)))
        self._larger = {key: one for key, one in self._larger.items() if allowed(one)}

    def best(self, size: int) -> Subset | None:
        sets = self.sets(size)
        return self._regrouped(sets[0]) if sets else None

    def added(self, candidate: Candidate, shape: dict[str, Any]) -> int:
        return self._joined(self._alone(candidate, shape))

    def add(self, shaped: ShapedCandidate) -> int:
        return self._joined(project(self.search.whitener, self.search.base, [shaped]))

    def _alone(self, candidate: Candidate, shape: dict[str, Any]) -> Projection:
        """The projection of a single candidate; other sets ask for the same shapes again."""
        key, search = (candidate, tuple(sorted(shape.items()))), self.search
        base, one = self._known.get(key, (None, None))
        if one is None or base is not search.base:
            shaped = one.candidates[0] if one else at_shape(search.evidence, candidate, shape)
            one = project(search.whitener, search.base, [shaped])
            self._known[key] = search.base, one
        return one

    def _joined(self, one: Projection) -> int:
        projection = self.search.projection.joined(one)
        self.search = replace(self.search, projection=projection)
        return len(projection.candidates) - 1

    def refine(self, subset: Subset) -> Subset:
        """The set with the shapes of its candidates refined, and its loads grouped."""
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
        """The set with one load for each group of recordings that agree; the lightest has none."""
        search, projection = self.search, self.search.projection
        candidate = projection.candidates[subset.numbers[place]].candidate
        each = self._alone(candidate, {LOADS: one_each(search.evidence)})
        inside = [int(c) for i in others(subset, place) for c in projection.columns_of[i]]
        known = leading(projection.columns[:, inside], len(inside))
        columns = beside(known, each.columns * each.scale)
        residual = beside(known, projection.residual)
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
        """Sought beside its point of the grid; from the edge of that, up to the next point."""
        start = self.search.projection.candidates[subset.numbers[place]]
        shape = start.candidate.shapes[name]
        points = len({one[name] for one in start.candidate.grid()})
        step, middle = 1.0 / max(points - 1, 1), shape.share(start.shape[name])
        near = NEIGHBOUR_SHARE * step
        low, high = max(middle - near, 0.0), min(middle + near, 1.0)
        subset = self._sought(subset, place, name, (low, high))
        found = self.search.projection.candidates[subset.numbers[place]]
        best, edge = shape.share(found.shape[name]), EDGE_SHARE * near
        if low > 0.0 and best - low < edge:
            return self._sought(subset, place, name, (max(middle - step, 0.0), low))
        if high < 1.0 and high - best < edge:
            return self._sought(subset, place, name, (high, min(middle + step, 1.0)))
        return subset

    def _sought(self, subset: Subset, place: int, name: str, bounds: tuple[float, float]) -> Subset:
        search = self.search
        start = search.projection.candidates[subset.numbers[place]]
        shape = start.candidate.shapes[name]
        tried: list[tuple[float, Projection]] = []

        def cost(share: float) -> float:
            one = self._alone(start.candidate, {**start.shape, name: shape.value(float(share))})
            gain = gain_beside(search.projection, others(subset, place), one)
            tried.append((gain, one))
            return -min(max(gain, 0.0), LARGEST_GAIN)

        minimize_scalar(cost, bounds=bounds, method="bounded", options={"maxiter": EVALUATIONS})
        gain, one = max(tried, key=lambda entry: entry[0])
        if gain <= subset.gain:
            return subset
        numbers = list(subset.numbers)
        numbers[place] = self._joined(one)
        return solve(self.search.projection, tuple(numbers)) or subset


def others(subset: Subset, place: int) -> tuple[int, ...]:
    """The candidates of a set without one of them."""
    return subset.numbers[:place] + subset.numbers[place + 1 :]


def gain_beside(projection: Projection, numbers: Sequence[int], one: Projection) -> float:
    """Gain of some candidates and the single one of `one`; -inf where a sign is wrong."""
    inside = np.array([c for i in numbers for c in projection.columns_of[i]], dtype=int)
    columns = np.concatenate([projection.columns[:, inside], one.columns], axis=1)
    positive = np.concatenate([projection.positive[inside], one.positive])
    score = columns.T @ projection.residual
    (values,), apart = constrained((columns.T @ columns)[None], score[None], positive[None])
    if not apart[0] or not values[len(inside) :].any():
        return -np.inf
    return float(values @ score)
