"""Which of the sets that the search found are findings, and what cannot be told from each."""

from dataclasses import dataclass

import numpy as np

from crane_identification.diagnosis.decision.chance import by_chance
from crane_identification.diagnosis.decision.cross_validation import helps
from crane_identification.diagnosis.decision.form import of_one_form
from crane_identification.diagnosis.decision.judgement import Judged, all_judged
from crane_identification.diagnosis.decision.likeness import (
    simplest,
)
from crane_identification.diagnosis.search.race import LARGEST_SET, Race
from crane_identification.diagnosis.search.selection import NOTHING
from crane_identification.thresholds import Thresholds


@dataclass(frozen=True)
class Decision:
    """The effects that the data ask for, strongest first, and the `threshold` of the first one.

    Where there are none, `nearest` is the best of the catalogue, if one has the right sign, and
    `objection` says which test it does not pass.
    """

    passed: tuple[Judged, ...]
    threshold: float
    nearest: tuple[Judged, ...]
    objection: str


def decide(race: Race, thresholds: Thresholds) -> Decision:
    """The largest set all of whose effects pass."""
    passed: tuple[Judged, ...] = ()
    nearest, objection = passed, ""
    _, first_threshold = by_chance(race.search, NOTHING, thresholds)
    for size in range(1, LARGEST_SET + 1):
        best, search = race.best(size), race.search
        if best is None:
            break
        subset = simplest(search, best, thresholds, first_threshold)
        if size > 1 and of_one_form(search, subset, thresholds):
            break
        found = all_judged(search, subset, thresholds)
        wrong = [said for one in found if (said := _objection(one, thresholds))]
        if size == 1:
            nearest, objection = tuple(found), "".join(wrong)
        if wrong or (size > 1 and _vague(min(found, key=lambda one: one.score), thresholds)):
            break
        passed = tuple(sorted(found, key=lambda one: -one.score))
    return Decision(passed, first_threshold, nearest, objection)


def _objection(one: Judged, thresholds: Thresholds) -> str:
    """Which test an effect does not pass; empty if it passes all."""
    if one.score <= one.threshold:
        return f"its score is {one.score:.0f}, and {one.threshold:.0f} is asked for"
    if one.strength < thresholds.gates.smallest_strength:
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
