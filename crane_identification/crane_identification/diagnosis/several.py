"""Physics that several joints lack at once, and scales of the forces of joints.

If each joint is asked by itself, the others still lack theirs, and bodies that they share make up
for it. So an effect without a nonlinear parameter is asked of all joints together, and kept on
those where it explains what it does not explain on the others.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import combinations
from typing import NamedTuple

import numpy as np

from crane_identification.diagnosis.constants import FEWEST_JOINTS, LENGTH_ERROR
from crane_identification.diagnosis.evidence import beside, leading
from crane_identification.diagnosis.judgement import (
    Judged,
    by_chance,
    found_values,
    held_out_gains,
    marginal,
)
from crane_identification.diagnosis.projection import (
    NOTHING,
    Projection,
    Subset,
    extended,
    solve,
)
from crane_identification.diagnosis.search import Search, columns_of_lengths


def on_several_joints(search: Search, threshold: float) -> Subset:
    """Effects that are missing on at least three joints each, strongest kind first. On three joints
    the loss without the effect exceeds the `threshold` and a share of that of the strongest effect;
    on the others it exceeds the chance gain of the best of that kind.
    """
    members, method = _kinds(search.projection), search.thresholds.method
    least = {
        number: limit
        for numbers in members.values()
        for limit in [chance_of_kind(search, numbers)]
        for number in numbers
    }
    chosen: tuple[str, ...] = ()
    found, first = NOTHING, 0.0

    def best(rest: tuple[str, ...]) -> tuple[Subset, tuple[str, ...]]:
        """The best set with one more kind beside the `rest`."""
        tried = []
        for kind in members.keys() - set(rest):
            kinds = (*rest, kind)
            numbers = [number for one in kinds for number in members[one]]
            kept, losses = _telling(search, numbers, least)
            asked = max(threshold, method.elsewhere_share * max(losses, default=0.0))
            clear = {n for n, loss in zip(kept.numbers, losses, strict=True) if loss > asked}
            if all(len(clear & set(members[one])) >= FEWEST_JOINTS for one in kinds):
                tried.append((kept, kinds))
        return max(tried, key=lambda one: (one[0].gain, one[1]), default=(NOTHING, ()))

    while True:
        more, kinds = best(chosen)
        for kind in kinds[:-1]:  # one that stood for what is now beside it
            other, swapped = best(tuple(one for one in kinds if one != kind))
            if other.gain > more.gain:
                more, kinds = other, swapped
        if more.gain - found.gain <= max(method.further_share * first, threshold):
            return found
        first = first or more.gain
        found, chosen = more, kinds


def chance_of_kind(search: Search, numbers: Sequence[int]) -> float:
    """The gain asked of the candidates with these numbers, by chance."""
    wanted = np.isin(np.arange(len(search.projection.candidates)), numbers)
    return by_chance(replace(search, projection=search.projection.kept(wanted)), NOTHING)


def _kinds(projection: Projection) -> dict[str, list[int]]:
    """Numbers, by type, of effects of single joints that several may lack at once."""
    out: dict[str, list[int]] = {}
    for number, shaped in enumerate(projection.candidates):
        one = shaped.candidate
        alone = one.shapes or one.changes or one.parts or one.effect.formless or one.effect.usual
        if one.joint is not None and not alone:
            out.setdefault(one.type, []).append(number)
    return {kind: numbers for kind, numbers in out.items() if len(numbers) >= FEWEST_JOINTS}


def _telling(
    search: Search, numbers: Sequence[int], least: Mapping[int, float]
) -> tuple[Subset, list[float]]:
    """The effects without each of which the others lose more than its `least`, with the losses."""
    left = list(numbers)
    while left:
        subset = solve(search.projection, tuple(left))
        if subset is None:  # the one that explains least by itself has a wrong sign
            alone = {i: solve(search.projection, (i,)) or NOTHING for i in left}
            left.remove(min(alone, key=lambda number: alone[number].gain))
            continue
        losses = marginal(search, subset)
        over = [loss / least[number] for loss, number in zip(losses, left, strict=True)]
        if min(over) > 1.0:
            return subset, losses
        del left[over.index(min(over))]
    return NOTHING, []


def as_kinds(search: Search, found: Sequence[Judged], known: int) -> list[Judged]:
    """The first `known` effects judged as kinds, on all of their joints together."""
    members, out = _kinds(search.projection), list(found)
    lacking = [one for one in found[:known] if not one.shaped.candidate.effect.formless]
    for kind in {one.shaped.candidate.type for one in lacking}:
        alike = [
            place < known and one.shaped.candidate.type == kind for place, one in enumerate(out)
        ]
        own, rest = (
            [one for one, here in zip(out, alike, strict=True) if here is which]
            for which in (True, False)
        )
        added = np.concatenate([one.shaped.columns for one in own], axis=2)
        gains, names = held_out_gains(search, [one.shaped.columns for one in rest], added)
        numbers = members.get(kind) or [search.number(one.shaped) for one in own]
        threshold = chance_of_kind(search, numbers)
        others = _other_kinds(own)
        for place in np.flatnonzero(alike):
            one = replace(out[place], held_out=gains, fold_names=names, threshold=threshold)
            out[place] = _beside_kinds(one, others)
    return out


class _Kind(NamedTuple):
    """Another kind in the place of one: its `lead` on all joints, and the lead that is asked."""

    lead: float
    asked: float


def _other_kinds(effects: Sequence[Judged]) -> dict[str, _Kind]:
    """The kinds, by type, that may replace `effects` of a kind; other effects are lost."""
    by_joint = [
        {
            one.candidate.type: one
            for one in reversed(effect.rivals)
            if one.candidate.joint == effect.shaped.candidate.joint
        }
        for effect in effects
    ]
    out = {}
    for kind in {kind for rivals in by_joint for kind in rivals}:
        leads = [
            rivals[kind].lead if kind in rivals else effect.score
            for effect, rivals in zip(effects, by_joint, strict=True)
        ]
        asked = max(rivals[kind].needed for rivals in by_joint if kind in rivals)
        out[kind] = _Kind(sum(leads), asked)
    return out


def _beside_kinds(one: Judged, others: Mapping[str, _Kind]) -> Judged:
    """An effect whose rivals are the kinds in the place of all of its own."""
    joint, every = one.shaped.candidate.joint, [rival.candidate for rival in one.rivals]
    rivals = [(other, others[other.type]) for other in every if other.joint == joint]
    if not rivals:
        return replace(one, indistinct=(), runner_up=None, margin=one.score)
    rivals.sort(key=lambda rival: rival[1].lead)
    alike = tuple(other for other, kind in rivals if kind.lead <= kind.asked)
    runner_up, first = rivals[0]
    return replace(
        one, indistinct=alike, runner_up=runner_up, margin=first.lead, needed=first.asked
    )


# Factors of the forces of joints, of which one is free: of all joints alike they scale the masses.
# So two of three joints' factors come to the same as two others.


def factors(search: Search) -> list[int]:
    """The numbers of the candidates that are a factor of a joint's force."""
    candidates = search.projection.candidates
    return [i for i, one in enumerate(candidates) if one.candidate.effect.formless]


def gain_of_few(search: Search) -> float:
    """Gain of the best effect by itself, or of the best factors of the forces of two joints."""
    alone = [one.gain for one in extended(search.projection, NOTHING)]
    return max([*alone, best_pair(search).gain])


def best_pair(search: Search) -> Subset:
    """The factors of the forces of two joints that gain most; nothing if there are no two."""
    both = (solve(search.projection, pair) for pair in combinations(factors(search), 2))
    return max((one for one in both if one is not None), key=lambda one: one.gain, default=NOTHING)


def smallest(search: Search, subset: Subset, tolerance: float) -> Subset:
    """The set with the smallest of the factors that come to the same within a `tolerance`."""
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
        values = [found_values(search, swapped, place)[0] for place in places]
        size = float(np.linalg.norm(values))
        if size < least * (1.0 - 1e-6):
            best, least = swapped, size
    return best


# Lengths of links and linkages, which are those of the file give or take `LENGTH_ERROR`.

LINKAGE = "linkage_scale"


def or_lengths(search: Search, found: Sequence[Judged]) -> tuple[Judged, ...]:
    """The effects; scales that likely lengths explain as well are ambiguous with linkages."""
    return tuple(
        _or_lengths(search, one, [other for other in found if other is not one])
        if one.shaped.candidate.effect.formless
        else one
        for one in found
    )


def _or_lengths(search: Search, scale: Judged, rest: Sequence[Judged]) -> Judged:
    if any(one.type == LINKAGE for one in (scale.shaped.candidate, *scale.indistinct)):
        return scale
    found = {one.shaped.candidate for one in rest}
    every = (search.projection.candidates[number] for number in factors(search))
    linkages = [one for one in every if one.candidate.type == LINKAGE]
    linkages = [one for one in linkages if one.candidate not in found]
    others = [one.shaped.columns for one in rest]
    lengths = [columns_of_lengths(search.evidence), *(one.columns for one in linkages)]
    none = search.evidence.base[:, :, :0]
    known, columns = search.beside(none, *others), search.beside(none, *lengths)
    known = leading(known, known.shape[1])
    columns, force = (beside(known, values) for values in (columns, search.base.residual))
    columns = LENGTH_ERROR * columns
    gram, score = columns.T @ columns + np.eye(columns.shape[1]), columns.T @ force
    explained = float(score @ np.linalg.solve(gram, score))
    if search.gained(others, scale.shaped.columns) - explained > scale.needed:
        return scale
    return replace(scale, indistinct=(*scale.indistinct, *(one.candidate for one in linkages)))
