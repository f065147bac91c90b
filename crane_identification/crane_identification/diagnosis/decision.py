"""Which of the sets that the search found are findings, and what cannot be told from each."""

from dataclasses import dataclass

import numpy as np

from crane_identification.diagnosis.candidates import Candidate, ShapedCandidate
from crane_identification.diagnosis.cross_validation import held_out_gains, helps
from crane_identification.diagnosis.likeness import (
    freedom,
    in_place_of,
    likeness,
    mends,
    same_as,
    same_effect,
    slight,
    strength,
    without,
)
from crane_identification.diagnosis.projection import null_gains
from crane_identification.diagnosis.search import LARGEST_SET, Race, Search
from crane_identification.diagnosis.selection import NOTHING, Subset, solve
from crane_identification.diagnosis.thresholds import Thresholds

IDENTICAL_CORRELATION = 1.0 - 1e-6
"""Above it, beside the model, an effect is the other one by another name."""


@dataclass(frozen=True)
class Judged:
    """An effect that was weighed against chance, held-out recordings and others in its place.

    `score`: 2 dlogL that the set loses without it; `threshold` and `null` (replicates,) of the best
    score when nothing is missing; `held_out` gains of the folds `fold_names`. `runner_up`: the best
    candidate in its place, `margin` behind by, where `needed` is asked for; `indistinct`: all that
    cannot be told from it. `strength`: rms of what it explains over that of its joint's force;
    `correlation` of the runner-up's columns with its own, beside the model.
    """

    shaped: ShapedCandidate
    score: float
    threshold: float
    null: np.ndarray
    held_out: np.ndarray
    fold_names: tuple[str, ...]
    runner_up: Candidate | None
    margin: float
    needed: float
    correlation: float
    indistinct: tuple[Candidate, ...]
    visibility: float
    strength: float


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
    first_threshold = _threshold(_null(race.search, NOTHING), thresholds)
    for size in range(1, LARGEST_SET + 1):
        best, search = race.best(size), race.search
        if best is None:
            break
        subset = _simplest(search, best, thresholds, first_threshold)
        if size > 1 and _of_one_form(search, subset, thresholds):
            break
        found = _all_judged(search, subset, thresholds)
        wrong = [said for one in found if (said := _objection(one, thresholds))]
        if size == 1:
            nearest, objection = tuple(found), "".join(wrong)
        if wrong or (size > 1 and _vague(min(found, key=lambda one: one.score), thresholds)):
            break
        passed = tuple(sorted(found, key=lambda one: -one.score))
    return Decision(passed, first_threshold, nearest, objection)


def _of_one_form(search: Search, subset: Subset, thresholds: Thresholds) -> bool:
    """Whether an effect of a set is but the form of another one of them.

    Changes of terms that the model has are of the model's own form.
    """
    if all(search.projection.candidates[number].candidate.changes for number in subset.numbers):
        return False
    gains = _marginal(search, subset)
    if slight([search.channels(number) for number in subset.numbers], gains, thresholds):
        return True
    return mends(search, subset.numbers, gains, thresholds)


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


def _null(search: Search, before: Subset) -> np.ndarray:
    columns_of = search.projection.columns_of
    inside = [int(c) for i in before.numbers for c in columns_of[i]]
    return null_gains(search.projection, inside)


def _threshold(null: np.ndarray, thresholds: Thresholds) -> float:
    level = 1.0 - thresholds.method.false_alarm_rate / 2.0
    return thresholds.gates.score_factor * float(np.quantile(null, level))


def _simplest(search: Search, subset: Subset, thresholds: Thresholds, threshold: float) -> Subset:
    """The set with effects replaced by simpler ones that they are no better than.

    Presliding over no way and a Stribeck curve without end are Coulomb friction.
    """
    method = thresholds.method
    for place in range(len(subset.numbers)):
        own = subset.numbers[place]
        needed = max(threshold, method.lead_share * _left(search, subset, place))
        for swapped in in_place_of(search, subset, place):
            other = swapped.numbers[-1]
            if subset.gain - swapped.gain > needed:
                break
            simpler = freedom(search, other) < freedom(search, own)
            if simpler and likeness(search, own, other) > method.form_correlation:
                order = (*subset.numbers[:place], other, *subset.numbers[place + 1 :])
                subset = solve(search.projection, order) or subset
                break
    return subset


def _left(search: Search, subset: Subset, place: int) -> float:
    """What a set leaves unexplained where one of its effects acts."""
    left = search.unexplained(subset)[search.channels(subset.numbers[place])].sum()
    return max(float(left), 0.0)


def _marginal(search: Search, subset: Subset) -> list[float]:
    """What the set loses without each of its effects."""
    places = range(len(subset.numbers))
    return [subset.gain - without(search, subset, place).gain for place in places]


def _all_judged(search: Search, subset: Subset, thresholds: Thresholds) -> list[Judged]:
    """The effects of a set, each against what chance adds to the best smaller set."""
    null = _null(search, search.sets[len(subset.numbers) - 1][0])
    threshold = _threshold(null, thresholds)
    return [
        _judged(search, subset, place, score, threshold, null, thresholds)
        for place, score in enumerate(_marginal(search, subset))
    ]


def _judged(
    search: Search,
    subset: Subset,
    place: int,
    score: float,
    threshold: float,
    null: np.ndarray,
    thresholds: Thresholds,
) -> Judged:
    projection, method = search.projection, thresholds.method
    number = subset.numbers[place]
    own = projection.candidates[number]
    rest = without(search, subset, place)
    swaps = [
        (swapped, alike)
        for swapped in in_place_of(search, subset, place)
        if (alike := likeness(search, number, swapped.numbers[-1])) > method.rival_correlation
        or same_effect(own.candidate, projection.candidates[swapped.numbers[-1]].candidate)
    ]
    left = _left(search, subset, place)
    # Beyond noise, what is left unexplained, and columns that are not quite those of the machine.
    needed = max(threshold, method.lead_share * left, (1.0 - method.alike_correlation**2) * score)
    needed_of_same = max(needed, method.kin_lead_share * left)
    indistinct: list[Candidate] = []
    for swapped, alike in swaps:
        other = projection.candidates[swapped.numbers[-1]]
        lead = subset.gain - swapped.gain
        related = same_effect(own.candidate, other.candidate)
        if other.shape or other.candidate.changes:
            form = method.form_correlation
        else:
            form = IDENTICAL_CORRELATION if own.candidate.changes else np.inf
        more = freedom(search, swapped.numbers[-1]) > freedom(search, number)
        if more and alike > form and not related:
            continue  # the same with more freedom, which it does not need
        if lead <= (needed_of_same if related else needed):
            indistinct.append(other.candidate)
    indistinct += same_as(
        search, [swapped for swapped, _ in swaps], indistinct, needed, method.alike_correlation
    )
    evidence = search.evidence
    columns = [projection.candidates[i].columns for i in rest.numbers]
    before = np.concatenate([evidence.free, *columns], axis=2)
    held_out, names = held_out_gains(evidence, search.whitener, before, own.columns)
    runner_up = projection.candidates[swaps[0][0].numbers[-1]].candidate if swaps else None
    closest = runner_up is not None and same_effect(own.candidate, runner_up)
    return Judged(
        shaped=own,
        score=score,
        threshold=threshold,
        null=null,
        held_out=held_out,
        fold_names=names,
        runner_up=runner_up,
        margin=subset.gain - swaps[0][0].gain if swaps else score,
        needed=needed_of_same if closest else needed,
        correlation=swaps[0][1] if swaps else 0.0,
        indistinct=tuple(indistinct),
        visibility=float(projection.visibility[number]),
        strength=strength(search, number, score),
    )
