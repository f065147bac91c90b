"""Forces that are but what lengths leave which are not those of the machine's file.

Such lengths leave a little on every joint, and need not be sure to do so, nor strong enough for a
name. What explains little beside them is no effect.
"""

from collections.abc import Sequence

import numpy as np

from crane_identification.diagnosis.decision.factors import factors
from crane_identification.diagnosis.decision.judgement import Judged
from crane_identification.diagnosis.search.energy import explained
from crane_identification.diagnosis.search.lengths import beside_lengths
from crane_identification.diagnosis.search.search import Search
from crane_identification.thresholds import Thresholds


def without_those_of_lengths(
    search: Search, found: tuple[Judged, ...], thresholds: Thresholds
) -> tuple[Judged, ...]:
    """The effects without those beside a stronger one that are of lengths, which explain as much
    in their place; scales may be of lengths.
    """
    strongest = max((one.score for one in found), default=0.0)
    weaker = [
        one for one in found if one.score < strongest and not one.shaped.candidate.effect.formless
    ]
    longer = beside_lengths(search) if weaker else search
    out = []
    for one in weaker:
        rest = [other.shaped.columns for other in found if other is not one]
        own = _gain(search, rest, one.shaped.columns)
        instead = _gain_of_lengths(search, longer, rest)
        if instead >= own and is_of_lengths(search, longer, rest, one.shaped.columns, thresholds):
            out.append(one)
    return tuple(one for one in found if not any(one is other for other in out))


def is_of_lengths(
    search: Search,
    longer: Search,
    rest: Sequence[np.ndarray],
    columns: np.ndarray,
    thresholds: Thresholds,
) -> bool:
    """Whether columns (n, c, k), beside the `rest` (n, c, k each), gain less than half as much in
    the `longer` search, beside lengths that are off, and scales of the forces of all joints.
    """
    gained = _gain(longer, [*rest, *_scales(longer)], columns)
    return gained < thresholds.method.simple_share * _gain(search, rest, columns)


def _gain(search: Search, rest: Sequence[np.ndarray], columns: np.ndarray) -> float:
    """What columns explain more than the `rest` does."""
    return explained(search, *rest, columns) - _explained(search, rest)


def _gain_of_lengths(search: Search, longer: Search, rest: Sequence[np.ndarray]) -> float:
    """What lengths that are off, and scales, explain more than the `rest` does."""
    before, after = (float(one.base.residual @ one.base.residual) for one in (search, longer))
    known = _explained(search, rest)
    return before - after + _explained(longer, [*rest, *_scales(longer)]) - known


def _explained(search: Search, columns: Sequence[np.ndarray]) -> float:
    return explained(search, *columns) if columns else 0.0


def _scales(search: Search) -> list[np.ndarray]:
    return [search.projection.candidates[number].columns for number in factors(search)]
