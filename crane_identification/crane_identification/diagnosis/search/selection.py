"""Which effects together explain the residual best: a beam search over sets of candidates."""

from collections.abc import Collection, Iterator, Sequence
from typing import NamedTuple

import numpy as np

from crane_identification.diagnosis.search.candidates import Candidate
from crane_identification.diagnosis.search.projection import Projection

BEAM = 24  # sets that are followed from each size to the next
SINGULAR_SHARE = 1e-6
"""Share of a column's norm left beside the chosen ones, below which it is one of them."""


class Subset(NamedTuple):
    """A set of candidates (numbers of the projection), its gain 2 dlogL, and the coefficients."""

    numbers: tuple[int, ...]
    gain: float
    values: np.ndarray  # of the columns of the candidates, one after another


NOTHING = Subset((), 0.0, np.zeros(0))


def larger_sets(
    projection: Projection, beam: Sequence[Subset], refused: Collection[Candidate] = ()
) -> list[Subset]:
    """The sets with one candidate more than those of `beam` that gain most, best first; without
    those that are `refused`.

    One set of shapes for each set of candidates. Sets in which a parameter has the wrong sign do
    not count: without that candidate they are no worse. Nor do those in which one is larger than
    its effect may be: columns that are nearly the same fit anything, if their values are opposite.
    """
    found: dict[frozenset, Subset] = {}
    for start in beam:
        for subset in extended(projection, start, refused):
            key = frozenset(projection.candidates[i].candidate for i in subset.numbers)
            if key not in found or subset.gain > found[key].gain:
                found[key] = subset
    return sorted(found.values(), key=lambda subset: -subset.gain)[:BEAM]


def extended(
    projection: Projection, start: Subset, refused: Collection[Candidate] = ()
) -> Iterator[Subset]:
    """`start` with each further candidate, at its best shape, where signs and sizes are right."""
    inside = [c for i in start.numbers for c in projection.columns_of[i]]
    gram, score = _without(projection, inside)
    left_out = {*refused} | {projection.candidates[i].candidate for i in start.numbers}
    gains = _single_gains(projection, gram, score)
    further = [
        number
        for number in _best_of_each(projection, gains)
        if projection.candidates[number].candidate not in left_out and gains[number] > 0.0
    ]
    for solved in _solved_each(projection, start.numbers, further):
        if solved is not None:
            yield solved


def _solved_each(
    projection: Projection, numbers: tuple[int, ...], further: Sequence[int]
) -> list[Subset | None]:
    """`solve` of the candidates `numbers` with each `further` one; those with as many columns all
    at once, as far as no sign is wrong.
    """
    out: list[Subset | None] = [None] * len(further)
    inside = [projection.columns_of[i] for i in numbers]
    counts = np.array([len(projection.columns_of[i]) for i in further], dtype=int)
    begins = np.cumsum([0, *(len(own) for own in inside)])
    for count in np.unique(counts):
        places = np.flatnonzero(counts == count).tolist()
        columns = np.stack(
            [np.concatenate([*inside, projection.columns_of[further[place]]]) for place in places]
        )
        free = _free(projection.gram, projection.score, columns, projection.positive[columns])
        for i, values, wrong in zip(*free, strict=True):
            each = (*numbers, further[places[i]])
            if wrong:
                out[places[i]] = solve(projection, each)
            elif np.logical_or.reduceat(values != 0.0, begins).all() and _possible(
                projection, columns[i], values
            ):
                gain = float(values @ projection.score[columns[i]])
                out[places[i]] = Subset(each, gain, values)
    return out


def _best_of_each(projection: Projection, gains: np.ndarray) -> list[int]:
    """The best shape of each candidate."""
    best: dict[object, int] = {}
    for number, shaped in enumerate(projection.candidates):
        known = best.get(shaped.candidate)
        if known is None or gains[number] > gains[known]:
            best[shaped.candidate] = number
    return list(best.values())


def _single_gains(projection: Projection, gram: np.ndarray, score: np.ndarray) -> np.ndarray:
    """Gain (candidates,) of each candidate by itself, -inf where signs are wrong."""
    diagonal = np.diag(gram)
    good = diagonal > SINGULAR_SHARE**2
    right = good & (~projection.positive | (score > 0.0))
    single = np.where(right, score**2 / np.where(good, diagonal, 1.0), -np.inf)
    gains = np.full(len(projection.candidates), -np.inf)
    for count, (numbers, columns) in projection.by_count.items():
        if count == 1:
            gains[numbers] = single[columns[:, 0]]
        elif count:
            gains[numbers] = _gains(gram, score, columns, projection.positive[columns])
    return gains


def _gains(
    gram: np.ndarray, score: np.ndarray, columns: np.ndarray, positive: np.ndarray
) -> np.ndarray:
    """Gain (m,) of m candidates by as many columns (m, k) each, as `_gain` of one."""
    gains = np.full(len(columns), -np.inf)
    for place, own, wrong in zip(*_free(gram, score, columns, positive), strict=True):
        if wrong:
            gains[place] = _gain(gram, score, columns[place], positive[place])
        elif own.any():
            gains[place] = own @ score[columns[place]]
    return gains


def _free(
    gram: np.ndarray, score: np.ndarray, columns: np.ndarray, positive: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Which of m sets of as many columns (m, k) each are apart, the solutions of these whatever
    their signs, and whether one that must be `positive` (m, k) is not.
    """
    blocks = gram[columns[:, :, np.newaxis], columns[:, np.newaxis]]
    apart = np.flatnonzero(np.linalg.eigvalsh(blocks)[:, 0] >= SINGULAR_SHARE**2)
    values = np.linalg.solve(blocks[apart], score[columns[apart]][..., np.newaxis])[..., 0]
    return apart, values, np.asarray((positive[apart] & (values < 0.0)).any(axis=1))


def _gain(gram: np.ndarray, score: np.ndarray, columns: np.ndarray, positive: np.ndarray) -> float:
    """Gain of a candidate's columns with those of wrong sign at zero; -inf if nothing is left."""
    block = np.ix_(columns, columns)
    values = constrained(gram[block], score[columns], positive)
    return -np.inf if values is None or not values.any() else float(values @ score[columns])


def constrained(gram: np.ndarray, score: np.ndarray, positive: np.ndarray) -> np.ndarray | None:
    """Solution of gram values = score with the `positive` values that would be negative at zero.

    None where columns coincide.
    """
    free = np.ones(len(score), dtype=bool)
    values = np.zeros(len(score))
    while free.any():
        part = gram[np.ix_(free, free)]
        if np.linalg.eigvalsh(part)[0] < SINGULAR_SHARE**2:
            return None
        values[:] = 0.0
        values[free] = np.linalg.solve(part, score[free])
        wrong = free & positive & (values < 0.0)
        if not wrong.any():
            break
        free &= ~wrong
    values[~free] = 0.0
    return values


def solve(projection: Projection, numbers: tuple[int, ...]) -> Subset | None:
    """Joint solution of a set of candidates; None where a sign is wrong, a parameter is larger than
    its effect may be, or columns coincide.

    A constrained parameter of a candidate with several may rest at zero.
    """
    columns = np.concatenate([projection.columns_of[i] for i in numbers])
    gram, score = projection.gram[np.ix_(columns, columns)], projection.score[columns]
    values = constrained(gram, score, projection.positive[columns])
    if values is None or not _possible(projection, columns, values):
        return None
    for number in numbers:
        if not values[projection.owner[columns] == number].any():
            return None
    return Subset(numbers, float(values @ score), values)


def _possible(projection: Projection, columns: np.ndarray, values: np.ndarray) -> bool:
    """Whether no coefficient is larger than the effect of its column may be."""
    return bool((np.abs(values) <= projection.largest[columns]).all())


def _without(projection: Projection, inside: list[int]) -> tuple[np.ndarray, np.ndarray]:
    """Gram matrix and score beside the columns `inside` (sweep)."""
    gram, score = projection.gram, projection.score
    if not inside:
        return gram, score
    block = gram[np.ix_(inside, inside)]
    mixed = np.linalg.solve(block, gram[inside])
    return gram - gram[:, inside] @ mixed, score - mixed.T @ score[inside]
