"""Which of the sets that the search found are findings, and what cannot be told from each."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from crane_identification.diagnosis.decision.chance import by_chance
from crane_identification.diagnosis.decision.cross_validation import helps
from crane_identification.diagnosis.decision.drawing import (
    best_beside,
    is_drawn,
    start_beside,
    weighed,
)
from crane_identification.diagnosis.decision.factors import best_pair, gain_of_few, smallest
from crane_identification.diagnosis.decision.form import of_one_form
from crane_identification.diagnosis.decision.judgement import Judged, all_judged
from crane_identification.diagnosis.decision.likeness import simplest
from crane_identification.diagnosis.decision.several import as_kinds, on_several_joints
from crane_identification.diagnosis.decision.shape import (
    as_drawn,
    covered,
    of_better_signature,
)
from crane_identification.diagnosis.decision.strange import with_strange
from crane_identification.diagnosis.search.lengths import beside_lengths
from crane_identification.diagnosis.search.race import LARGEST_SET, Race
from crane_identification.diagnosis.search.selection import NOTHING, solve
from crane_identification.thresholds import Thresholds


@dataclass(frozen=True)
class Decision:
    """The effects that the data ask for, strongest first, and the `threshold` of the first one.

    Where there are none, `nearest` is the best of the catalogue, if one has the right sign, and
    `objection` says which test it does not pass. `strange` are forces of no effect, in words.
    """

    passed: tuple[Judged, ...]
    threshold: float
    nearest: tuple[Judged, ...]
    objection: str
    strange: tuple[str, ...]


def decide(race: Race, thresholds: Thresholds) -> Decision:
    """The largest set all of whose effects pass, beside those that several joints lack at once or,
    where the force of a joint is scaled, beside lengths that are not those of the file.
    """
    _, first_threshold = by_chance(race.search, NOTHING, thresholds)
    settled = _together(race, first_threshold, thresholds)
    alone = not settled
    passed, nearest, objection = _grown(race, settled, first_threshold, thresholds, alone)
    if alone and any(_scales(one) for one in passed):
        passed = _beside_lengths(race, passed, first_threshold, thresholds)
    passed = as_drawn(race, passed, thresholds)
    if start_beside(race, passed):
        passed = _grown(race, passed, first_threshold, thresholds).passed
    passed, beyond = with_strange(race.search, passed, first_threshold, thresholds)
    passed = tuple(sorted(passed, key=lambda one: -one.score))
    return Decision(passed, first_threshold, nearest, objection, beyond)


class _Grown(NamedTuple):
    """The effects that `passed`; where the race began with nothing, what came `nearest`."""

    passed: tuple[Judged, ...]
    nearest: tuple[Judged, ...] = ()
    objection: str = ""


def _grown(
    race: Race,
    settled: tuple[Judged, ...],
    threshold: float,
    thresholds: Thresholds,
    up_to_scale: bool = False,
) -> _Grown:
    """The `settled` effects, with which the race begins, and as many more as pass, or as do
    `up_to_scale` of the force of a joint.
    """
    passed, known = settled, len(settled)
    nearest, objection = tuple[Judged, ...](), ""
    for size in range(known + 1, known + LARGEST_SET + 1):
        best, search = best_beside(race, size, settled), race.search
        if best is None:
            break
        subset = simplest(search, best, thresholds, threshold, known)
        subset = smallest(search, subset, threshold)
        if size > 1 and of_one_form(search, subset, threshold, thresholds, known):
            break
        subset, strange = of_better_signature(search, subset, thresholds, known)
        if size > 1 and covered(search, subset, thresholds, known):
            break
        found = weighed(search, subset, settled, thresholds)
        asked = [
            one for k, one in enumerate(found) if k >= known or not (_scales(one) or is_drawn(one))
        ]
        wrong = [said for one in asked if (said := _objection(one, thresholds))] or strange
        if size == 1:
            nearest, objection = tuple(found), "".join(wrong)
        weakest = min(found[known:], key=lambda one: one.score)
        if wrong or (size > 1 and _vague(weakest, thresholds)):
            break
        passed = tuple(found)
        if up_to_scale and any(_scales(one) for one in passed):
            break
    return _Grown(passed, nearest, objection)


def _beside_lengths(
    race: Race, passed: tuple[Judged, ...], threshold: float, thresholds: Thresholds
) -> tuple[Judged, ...]:
    """What passes beside lengths of all links and the scales of two joints' forces, which stand for
    those of all; these as well, as far as they pass. If nothing does, what passes beside lengths of
    links alone, where that explains more than the scales.

    Lengths that are not those of the file are so on each joint. With one scale alone, what the
    others leave blurs a further effect, and may be taken for it. Whether each scale is sure, and
    which they are, is nothing to a further effect.
    """
    search = race.search = beside_lengths(race.search)
    numbers = tuple(search.number(one.shaped) for one in passed if _scales(one))
    scales = max(
        best_pair(search), solve(search.projection, numbers) or NOTHING, key=lambda one: one.gain
    )
    scales = smallest(search, scales, threshold)
    race.go_on_from(scales)
    settled = tuple(all_judged(race.search, scales, thresholds))
    found = _grown(race, settled, threshold, thresholds).passed
    if len(found) == len(settled):
        race.go_on_from(NOTHING)
        other = _grown(race, (), threshold, thresholds).passed
        numbers = tuple(race.search.number(one.shaped) for one in other)
        together = (solve(race.search.projection, numbers) if numbers else None) or NOTHING
        found = other if together.gain - scales.gain > threshold else found
    return _sure(race, found, thresholds) or passed


def _sure(race: Race, found: tuple[Judged, ...], thresholds: Thresholds) -> tuple[Judged, ...]:
    """The effects without scales that do not pass, and without the weaker one of two where one of
    them cannot be told from what is no scale; judged without them.
    """
    scales = sorted((one for one in found if _scales(one)), key=lambda one: one.score)
    out = [one for one in scales if _objection(one, thresholds)]
    out += scales[:1] if len(scales) > 1 and any(_mistakable(one) for one in scales) else []
    left = [one for one in found if not any(one is other for other in out)]
    if len(left) == len(found) or not left:
        return tuple(left)
    numbers = tuple(race.search.number(one.shaped) for one in left)
    race.go_on_from(solve(race.search.projection, numbers) or NOTHING)
    return tuple(all_judged(race.search, race.search.sets[-1][0], thresholds))


def _mistakable(one: Judged) -> bool:
    """Whether a scale cannot be told from an effect that is none."""
    return not all(other.effect.formless for other in one.indistinct)


def _scales(one: Judged) -> bool:
    """Whether an effect is a factor of the force of a joint, as lengths that are off make it."""
    return one.shaped.candidate.effect.formless


def _together(race: Race, threshold: float, thresholds: Thresholds) -> tuple[Judged, ...]:
    """What several joints lack at once, each of it judged beside the rest; the race goes on there.

    None where one effect, or what scales the forces of two joints, explains about as much: what it
    leaves is for the race.
    """
    search = race.search
    subset = on_several_joints(search, threshold, thresholds)
    if subset.gain - gain_of_few(search) <= thresholds.method.further_share * subset.gain:
        return ()
    while subset.numbers:
        race.go_on_from(subset)
        found = all_judged(race.search, subset, thresholds)
        found = as_kinds(race.search, found, len(found), thresholds)
        left = [one for one in found if not _objection(one, thresholds)]
        if len(left) == len(found):
            return tuple(found)
        numbers = tuple(search.number(one.shaped) for one in left)
        subset = (solve(search.projection, numbers) or NOTHING) if numbers else NOTHING
    race.go_on_from(NOTHING)
    return ()


def _objection(one: Judged, thresholds: Thresholds) -> str:
    """Which test an effect does not pass; empty if it passes all."""
    if one.score <= one.threshold:
        return f"its score is {one.score:.0f}, and {one.threshold:.0f} is asked for"
    scales = _scales(one)  # what is usual of it says its value
    if one.strength < thresholds.gates.smallest_strength and not scales:
        return (
            f"it is {one.strength:.2g} of the drive force, where the errors of the processing "
            f"itself reach {thresholds.gates.smallest_strength:.2g}"
        )
    if not helps(one.held_out, thresholds):
        asked = one.held_out[np.isfinite(one.held_out)]
        return (
            f"it improves the prediction of {int((asked > 0.0).sum())} of the "
            f"{len(one.held_out)} parts that it was not fitted to"
        )
    return ""


def _vague(one: Judged, thresholds: Thresholds) -> bool:
    """Whether a further effect is no better than others that look different.

    That is what remains where the first one has another form than the catalogue gives it.
    """
    return bool(one.indistinct) and one.correlation < thresholds.method.distinct_correlation
