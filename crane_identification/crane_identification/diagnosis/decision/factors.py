"""Factors of the forces of joints, of which one is free: of all joints alike they scale the masses.

So two of three joints' factors come to the same as two others.
"""

from itertools import combinations

import numpy as np

from crane_identification.diagnosis.search.search import Search
from crane_identification.diagnosis.search.selection import NOTHING, Subset, extended, solve


def factors(search: Search) -> list[int]:
    """The numbers of the candidates that are a factor of a joint's force."""
    candidates = search.projection.candidates
    return [i for i, one in enumerate(candidates) if one.candidate.effect.formless]


def gain_of_few(search: Search) -> float:
    """What the best effect gains by itself, or the best factors of the forces of two joints."""
    projection = search.projection
    alone = [one.gain for one in extended(projection, NOTHING)]
    return max([*alone, best_pair(search).gain])


def best_pair(search: Search) -> Subset:
    """The factors of the forces of two joints that gain most; nothing where there are no two."""
    both = (solve(search.projection, pair) for pair in combinations(factors(search), 2))
    return max((one for one in both if one is not None), key=lambda one: one.gain, default=NOTHING)


def smallest(search: Search, subset: Subset, tolerance: float) -> Subset:
    """The set with its factors replaced by those that come to the same, to a `tolerance` of gain,
    and are smallest: a file errs rather by little. Of equals, the first in the catalogue.
    """
    known = factors(search)
    places = [place for place, number in enumerate(subset.numbers) if number in known]
    best, least = subset, np.inf
    for several in combinations(known, len(places)) if places else ():
        numbers = list(subset.numbers)
        for place, number in zip(places, several, strict=True):
            numbers[place] = number
        swapped = solve(search.projection, tuple(numbers))
        if swapped is None or subset.gain - swapped.gain > tolerance:
            continue
        if (size := _size(search, swapped, places)) < least * (1.0 - 1e-6):
            best, least = swapped, size
    return best


def _size(search: Search, subset: Subset, places: list[int]) -> float:
    """Norm of the factors at these places of a set."""
    projection = search.projection
    columns = [c for number in subset.numbers for c in projection.columns_of[number]]
    values = dict(zip(columns, subset.values, strict=True))
    own = [projection.columns_of[subset.numbers[place]][0] for place in places]
    return float(np.linalg.norm([values[c] / projection.scale[c] for c in own]))
