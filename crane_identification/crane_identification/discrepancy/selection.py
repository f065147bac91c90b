"""Which effects together explain the residual best: a beam search over sets of families."""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from crane_identification.discrepancy.projection import Projection

BEAM = 24  # sets that are followed from each size to the next
LARGEST_SET = 3
SINGULAR = (
    1e-6  # share of a column's norm left beside the chosen ones below which it is one of them
)


class Choice(NamedTuple):
    """A set of options (numbers of the projection), its gain 2 dlogL, and the coefficients."""

    options: tuple[int, ...]
    gain: float
    values: np.ndarray  # of the columns of the options, one after another


def best_sets(projection: Projection, largest: int = LARGEST_SET) -> list[list[Choice]]:
    """For each size from 1, the sets of families with the largest gain, best first.

    One set of options for each set of families. Sets in which a parameter has the wrong sign do
    not count: without that option they are no worse.
    """
    beam: list[Choice] = [Choice((), 0.0, np.zeros(0))]
    sizes = []
    for _ in range(largest):
        found: dict[frozenset, Choice] = {}
        for start in beam:
            for choice in extended(projection, start):
                key = frozenset(projection.options[i].family for i in choice.options)
                if key not in found or choice.gain > found[key].gain:
                    found[key] = choice
        beam = sorted(found.values(), key=lambda choice: -choice.gain)[:BEAM]
        if not beam:
            break
        sizes.append(beam)
    return sizes


def extended(projection: Projection, start: Choice) -> Iterator[Choice]:
    """`start` with each option of another family, where all signs are right."""
    inside = [c for i in start.options for c in projection.members[i]]
    gram, score = _without(projection, inside)
    present = {projection.options[i].family for i in start.options}
    gains = option_gains(projection, gram, score)
    limit = _promising(projection, gains)
    for number in limit:
        if projection.options[number].family in present or not gains[number] > 0.0:
            continue
        solved = solve(projection, (*start.options, int(number)))
        if solved is not None:
            yield solved


def _promising(projection: Projection, gains: np.ndarray) -> list[int]:
    """The best option of each family."""
    best: dict[object, int] = {}
    for number, option in enumerate(projection.options):
        known = best.get(option.family)
        if known is None or gains[number] > gains[known]:
            best[option.family] = number
    return list(best.values())


def option_gains(projection: Projection, gram: np.ndarray, score: np.ndarray) -> np.ndarray:
    """Gain (options,) of each option by itself, -inf where signs are wrong."""
    diagonal = np.diag(gram)
    good = diagonal > SINGULAR**2
    right = good & (~projection.positive | (score > 0.0))
    single = np.where(right, score**2 / np.where(good, diagonal, 1.0), -np.inf)
    gains = np.full(len(projection.options), -np.inf)
    for number, columns in enumerate(projection.members):
        if len(columns) == 1:
            gains[number] = single[columns[0]]
            continue
        solution = _constrained(gram, score, columns, projection.positive[columns])
        gains[number] = solution
    return gains


def _constrained(
    gram: np.ndarray, score: np.ndarray, columns: np.ndarray, positive: np.ndarray
) -> float:
    """Largest gain of any subset of an option's columns whose signs are right."""
    best = -np.inf
    for code in range(1, 2 ** len(columns)):
        chosen = np.flatnonzero([(code >> bit) & 1 for bit in range(len(columns))])
        part = columns[chosen]
        block = gram[np.ix_(part, part)]
        if np.linalg.eigvalsh(block)[0] < SINGULAR**2:
            continue
        values = np.linalg.solve(block, score[part])
        if (values[positive[chosen]] >= 0.0).all():
            best = max(best, float(values @ score[part]))
    return best


def solve(projection: Projection, numbers: tuple[int, ...]) -> Choice | None:
    """Joint solution of a set of options; None where a sign is wrong or columns coincide.

    A constrained parameter of an option with several may rest at zero.
    """
    columns = np.concatenate([projection.members[i] for i in numbers])
    free = np.ones(len(columns), dtype=bool)
    values = np.zeros(len(columns))
    positive = projection.positive[columns]
    while free.any():
        values[:] = 0.0
        part = columns[free]
        gram = projection.gram[np.ix_(part, part)]
        if np.linalg.eigvalsh(gram)[0] < SINGULAR**2:
            return None
        values[free] = np.linalg.solve(gram, projection.score[part])
        wrong = free & positive & (values < 0.0)
        if not wrong.any():
            break
        free &= ~wrong
    values[~free] = 0.0
    for number in numbers:
        if not values[projection.owner[columns] == number].any():
            return None
    return Choice(numbers, float(values @ projection.score[columns]), values)


def _without(projection: Projection, inside: list[int]) -> tuple[np.ndarray, np.ndarray]:
    """Gram matrix and score beside the columns `inside` (sweep)."""
    gram, score = projection.gram, projection.score
    if not inside:
        return gram, score
    block = gram[np.ix_(inside, inside)]
    mixed = np.linalg.solve(block, gram[inside])
    return gram - gram[:, inside] @ mixed, score - mixed.T @ score[inside]
