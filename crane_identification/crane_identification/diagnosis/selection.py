"""Which effects together explain the residual best: a beam search over sets of families."""

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from crane_identification.diagnosis.projection import Projection

BEAM = 24  # sets that are followed from each size to the next
SINGULAR_SHARE = 1e-6
"""Share of a column's norm left beside the chosen ones, below which it is one of them."""


class Choice(NamedTuple):
    """A set of options (numbers of the projection), its gain 2 dlogL, and the coefficients."""

    options: tuple[int, ...]
    gain: float
    values: np.ndarray  # of the columns of the options, one after another


NOTHING = Choice((), 0.0, np.zeros(0))


def larger_sets(projection: Projection, beam: Sequence[Choice]) -> list[Choice]:
    """The sets with one family more than those of `beam` that gain most, best first.

    One set of options for each set of families. Sets in which a parameter has the wrong sign do
    not count: without that option they are no worse.
    """
    found: dict[frozenset, Choice] = {}
    for start in beam:
        for choice in extended(projection, start):
            key = frozenset(projection.options[i].family for i in choice.options)
            if key not in found or choice.gain > found[key].gain:
                found[key] = choice
    return sorted(found.values(), key=lambda choice: -choice.gain)[:BEAM]


def extended(projection: Projection, start: Choice) -> Iterator[Choice]:
    """`start` with each option of another family, where all signs are right."""
    inside = [c for i in start.options for c in projection.members[i]]
    gram, score = _without(projection, inside)
    present = {projection.options[i].family for i in start.options}
    gains = _option_gains(projection, gram, score)
    for number in _best_of_families(projection, gains):
        if projection.options[number].family in present or not gains[number] > 0.0:
            continue
        solved = solve(projection, (*start.options, int(number)))
        if solved is not None:
            yield solved


def _best_of_families(projection: Projection, gains: np.ndarray) -> list[int]:
    """The best option of each family."""
    best: dict[object, int] = {}
    for number, option in enumerate(projection.options):
        known = best.get(option.family)
        if known is None or gains[number] > gains[known]:
            best[option.family] = number
    return list(best.values())


def _option_gains(projection: Projection, gram: np.ndarray, score: np.ndarray) -> np.ndarray:
    """Gain (options,) of each option by itself, -inf where signs are wrong."""
    diagonal = np.diag(gram)
    good = diagonal > SINGULAR_SHARE**2
    right = good & (~projection.positive | (score > 0.0))
    single = np.where(right, score**2 / np.where(good, diagonal, 1.0), -np.inf)
    gains = np.full(len(projection.options), -np.inf)
    for number, columns in enumerate(projection.members):
        if len(columns) == 1:
            gains[number] = single[columns[0]]
            continue
        gains[number] = _gain(gram, score, columns, projection.positive[columns])
    return gains


def _gain(gram: np.ndarray, score: np.ndarray, columns: np.ndarray, positive: np.ndarray) -> float:
    """Gain of an option's columns with those of wrong sign at zero; -inf if nothing is left."""
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


def solve(projection: Projection, numbers: tuple[int, ...]) -> Choice | None:
    """Joint solution of a set of options; None where a sign is wrong or columns coincide.

    A constrained parameter of an option with several may rest at zero.
    """
    columns = np.concatenate([projection.members[i] for i in numbers])
    gram, score = projection.gram[np.ix_(columns, columns)], projection.score[columns]
    values = constrained(gram, score, projection.positive[columns])
    if values is None:
        return None
    for number in numbers:
        if not values[projection.owner[columns] == number].any():
            return None
    return Choice(numbers, float(values @ score), values)


def others(choice: Choice, place: int) -> tuple[int, ...]:
    """The options of a set without one of them."""
    return choice.options[:place] + choice.options[place + 1 :]


class Beside:
    """Gains of further options beside some that a projection has."""

    def __init__(self, projection: Projection, numbers: tuple[int, ...]) -> None:
        inside = [column for i in numbers for column in projection.members[i]]
        self._inside = np.array(inside, dtype=int)
        self._projection = projection

    def gain(self, one: Projection) -> float:
        """Gain of the set with the single option of `one`; -inf where a sign is wrong."""
        old, inside = self._projection, self._inside
        columns = np.concatenate([old.columns[:, inside], one.columns], axis=1)
        positive = np.concatenate([old.positive[inside], one.positive])
        score = columns.T @ old.residual
        values = constrained(columns.T @ columns, score, positive)
        if values is None or not values[len(inside) :].any():
            return -np.inf
        return float(values @ score)


def _without(projection: Projection, inside: list[int]) -> tuple[np.ndarray, np.ndarray]:
    """Gram matrix and score beside the columns `inside` (sweep)."""
    gram, score = projection.gram, projection.score
    if not inside:
        return gram, score
    block = gram[np.ix_(inside, inside)]
    mixed = np.linalg.solve(block, gram[inside])
    return gram - gram[:, inside] @ mixed, score - mixed.T @ score[inside]
