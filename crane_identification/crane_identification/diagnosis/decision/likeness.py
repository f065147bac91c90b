"""Others in the place of an effect: which explain as much, and how alike they are."""

from collections.abc import Sequence

import numpy as np

from crane_identification.diagnosis.search.candidates import Candidate
from crane_identification.diagnosis.search.energy import unexplained_beside
from crane_identification.diagnosis.search.projection import Projection
from crane_identification.diagnosis.search.race import others
from crane_identification.diagnosis.search.search import Search
from crane_identification.diagnosis.search.selection import (
    NOTHING,
    Subset,
    constrained,
    extended,
    solve,
)
from crane_identification.thresholds import Thresholds


def without(search: Search, subset: Subset, place: int) -> Subset:
    """The set without one of its effects."""
    rest = others(subset, place)
    return (solve(search.projection, rest) or NOTHING) if rest else NOTHING


def in_place_of(search: Search, subset: Subset, place: int) -> list[Subset]:
    """The set with each other candidate in the place of one of its effects, best first."""
    projection = search.projection
    candidate = projection.candidates[subset.numbers[place]].candidate
    replaced = extended(projection, without(search, subset, place))
    ranked = sorted(replaced, key=lambda one: -one.gain)
    return [one for one in ranked if projection.candidates[one.numbers[-1]].candidate != candidate]


def freedom(search: Search, number: int) -> int:
    """Number of parameters of a candidate, shapes included, and one for what the model lacks."""
    shaped = search.projection.candidates[number]
    return len(shaped.positive) + len(shaped.candidate.shapes) + (not shaped.candidate.changes)


def same_effect(one: Candidate, other: Candidate) -> bool:
    """Whether both are laws of the same effect, on the same joint."""
    return one.joint == other.joint and other.type in one.effect.kin


def likeness(search: Search, one: int, other: int) -> float:
    """Cosine of the angle by which what one candidate explains lies outside the other, beside the
    base: of the one with fewer columns the worst of them, as far as the signs of parameters let the
    other one follow it.
    """
    projection = search.projection
    a, b = projection.columns_of[one], projection.columns_of[other]
    gram, free = projection.gram, ~projection.positive
    if len(a) > 1 and len(b) > 1 and free[a].all() and free[b].all():
        roots = [np.linalg.cholesky(gram[np.ix_(c, c)] + 1e-12 * np.eye(len(c))) for c in (a, b)]
        mixed = np.linalg.solve(roots[0], np.linalg.solve(roots[1], gram[np.ix_(b, a)]).T)
        return float(np.linalg.svd(mixed, compute_uv=False).min())
    pairs = [(few, many) for few, many in ((a, b), (b, a)) if len(few) <= len(many)]
    return min(
        max(_followed(projection, sign, column, many) for sign in _signs(free[column]))
        for few, many in pairs
        for column in few
    )


def _signs(free: bool) -> tuple[float, ...]:
    """Signs that a parameter may have."""
    return (1.0, -1.0) if free else (1.0,)


def _followed(projection: Projection, sign: float, column: int, others: np.ndarray) -> float:
    """Cosine between a column of that sign and the nearest force that others can have."""
    inner = sign * projection.gram[others, column]
    block = projection.gram[np.ix_(others, others)]
    values = constrained(block, inner, projection.positive[others])
    return 0.0 if values is None else float(np.sqrt(max(values @ inner, 0.0)))


def same_as(
    search: Search,
    swaps: Sequence[Subset],
    indistinct: Sequence[Candidate],
    needed: float,
    alike: float,
) -> list[Candidate]:
    """Further candidates that are no worse than one of the class, and whose columns are `alike` to
    its own: they belong to the class as well.
    """
    candidates = search.projection.candidates
    known = [one for one in swaps if candidates[one.numbers[-1]].candidate in indistinct]
    return [
        candidates[one.numbers[-1]].candidate
        for one in swaps
        if one not in known
        and any(
            own.gain - one.gain <= needed
            and likeness(search, one.numbers[-1], own.numbers[-1]) > alike
            for own in known
        )
    ]


def simplest(
    search: Search, subset: Subset, thresholds: Thresholds, threshold: float, settled: int = 0
) -> Subset:
    """The set with effects replaced by simpler ones that they are no better than. The first ones,
    `settled`, stay.

    Presliding over no way and a Stribeck curve without end are Coulomb friction.
    """
    method = thresholds.method
    for place in range(settled, len(subset.numbers)):
        own, swaps = subset.numbers[place], in_place_of(search, subset, place)
        needed = max(threshold, method.lead_share * unexplained_beside(search, subset, place))
        for swapped in swaps:
            other = swapped.numbers[-1]
            if subset.gain - swapped.gain > needed:
                break
            simpler = freedom(search, other) < freedom(search, own)
            if simpler and likeness(search, own, other) > method.form_correlation:
                order = (*subset.numbers[:place], other, *subset.numbers[place + 1 :])
                subset = solve(search.projection, order) or subset
                break
    return subset
