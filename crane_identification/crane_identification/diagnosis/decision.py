"""Which of the sets that the search found are findings, and which rivals each has."""

from dataclasses import dataclass

import numpy as np

from crane_identification.diagnosis.candidates import Family, Option
from crane_identification.diagnosis.cross_validation import held_out_gains, helps
from crane_identification.diagnosis.projection import null_gains
from crane_identification.diagnosis.rivals import (
    freedom,
    in_place_of,
    kin,
    likeness,
    mends,
    same_as,
    slight,
    strength,
    without,
)
from crane_identification.diagnosis.search import LARGEST_SET, Race, Search
from crane_identification.diagnosis.selection import NOTHING, Choice, solve
from crane_identification.diagnosis.thresholds import Thresholds

IDENTICAL_CORRELATION = 1.0 - 1e-6
"""Above it, beside the model, an effect is the other one by another name."""


@dataclass(frozen=True)
class Judged:
    """An effect that was weighed against chance, held-out recordings and its rivals.

    `score`: 2 dlogL that the set loses without it; `threshold` and `null` (replicates,) of the best
    score when nothing is missing; `held_out` gains of the folds `fold_names`. `runner_up`: the best
    family in its place, `margin` behind by, where `needed` is asked for; `members`: all families
    that cannot be told from it. `strength`: rms of what it explains over that of its joint's force;
    `correlation` of the runner-up's columns with its own, beside the model.
    """

    option: Option
    score: float
    threshold: float
    null: np.ndarray
    held_out: np.ndarray
    fold_names: tuple[str, ...]
    runner_up: Family | None
    margin: float
    needed: float
    correlation: float
    members: tuple[Family, ...]
    visibility: float
    strength: float


@dataclass(frozen=True)
class Decision:
    """The effects that the data ask for, strongest first, and the `threshold` of the first one.

    Where there are none, `nearest` is the best of the catalogue, if one has the right sign, and
    `objection` says which test it does not pass.
    """

    accepted: tuple[Judged, ...]
    threshold: float
    nearest: tuple[Judged, ...]
    objection: str


def decide(race: Race, thresholds: Thresholds) -> Decision:
    """The largest set all of whose effects pass."""
    accepted: tuple[Judged, ...] = ()
    nearest, objection = accepted, ""
    first_threshold = _threshold(_null(race.search, NOTHING), thresholds)
    for size in range(1, LARGEST_SET + 1):
        best, search = race.best(size), race.search
        if best is None:
            break
        choice = _simplest(search, best, thresholds, first_threshold)
        if size > 1 and _of_one_form(search, choice, thresholds):
            break
        found = _all_judged(search, choice, thresholds)
        wrong = [said for one in found if (said := _objection(one, thresholds))]
        if size == 1:
            nearest, objection = tuple(found), "".join(wrong)
        if wrong or (size > 1 and _vague(min(found, key=lambda one: one.score), thresholds)):
            break
        accepted = tuple(sorted(found, key=lambda one: -one.score))
    return Decision(accepted, first_threshold, nearest, objection)


def _of_one_form(search: Search, choice: Choice, thresholds: Thresholds) -> bool:
    """Whether an effect of a set is but the form of another one of them.

    Changes of terms that the model has are of the model's own form.
    """
    if all(search.projection.options[number].family.changes for number in choice.options):
        return False
    gains = _marginal(search, choice)
    if slight([search.channels(number) for number in choice.options], gains, thresholds):
        return True
    return mends(search, choice.options, gains, thresholds)


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
    return bool(one.members) and one.correlation < thresholds.method.distinct_correlation


def _null(search: Search, before: Choice) -> np.ndarray:
    members = search.projection.members
    inside = [int(c) for i in before.options for c in members[i]]
    return null_gains(search.projection, inside)


def _threshold(null: np.ndarray, thresholds: Thresholds) -> float:
    level = 1.0 - thresholds.method.false_alarm_rate / 2.0
    return thresholds.gates.score_factor * float(np.quantile(null, level))


def _simplest(search: Search, choice: Choice, thresholds: Thresholds, threshold: float) -> Choice:
    """The set with effects replaced by simpler ones that they are no better than.

    Presliding over no way and a Stribeck curve without end are Coulomb friction.
    """
    method = thresholds.method
    for place in range(len(choice.options)):
        own = choice.options[place]
        needed = max(threshold, method.lead_share * _left(search, choice, place))
        for rival in in_place_of(search, choice, place):
            other = rival.options[-1]
            if choice.gain - rival.gain > needed:
                break
            simpler = freedom(search, other) < freedom(search, own)
            if simpler and likeness(search, own, other) > method.form_correlation:
                order = (*choice.options[:place], other, *choice.options[place + 1 :])
                choice = solve(search.projection, order) or choice
                break
    return choice


def _left(search: Search, choice: Choice, place: int) -> float:
    """What a set leaves unexplained where one of its effects acts."""
    left = search.unexplained(choice)[search.channels(choice.options[place])].sum()
    return max(float(left), 0.0)


def _marginal(search: Search, choice: Choice) -> list[float]:
    """What the set loses without each of its effects."""
    places = range(len(choice.options))
    return [choice.gain - without(search, choice, place).gain for place in places]


def _all_judged(search: Search, choice: Choice, thresholds: Thresholds) -> list[Judged]:
    """The effects of a set, each against what chance adds to the best smaller set."""
    null = _null(search, search.sets[len(choice.options) - 1][0])
    threshold = _threshold(null, thresholds)
    return [
        _judged(search, choice, place, score, threshold, null, thresholds)
        for place, score in enumerate(_marginal(search, choice))
    ]


def _judged(
    search: Search,
    choice: Choice,
    place: int,
    score: float,
    threshold: float,
    null: np.ndarray,
    thresholds: Thresholds,
) -> Judged:
    projection, method = search.projection, thresholds.method
    number = choice.options[place]
    own = projection.options[number]
    rest = without(search, choice, place)
    rivals = [
        (rival, alike)
        for rival in in_place_of(search, choice, place)
        if (alike := likeness(search, number, rival.options[-1])) > method.rival_correlation
        or kin(own.family, projection.options[rival.options[-1]].family)
    ]
    left = _left(search, choice, place)
    # Beyond noise, what is left unexplained, and columns that are not quite those of the machine.
    needed = max(threshold, method.lead_share * left, (1.0 - method.alike_correlation**2) * score)
    needed_of_kin = max(needed, method.kin_lead_share * left)
    members: list[Family] = []
    for rival, alike in rivals:
        other = projection.options[rival.options[-1]]
        lead = choice.gain - rival.gain
        related = kin(own.family, other.family)
        if other.shape or other.family.changes:
            form = method.form_correlation
        else:
            form = IDENTICAL_CORRELATION if own.family.changes else np.inf
        more = freedom(search, rival.options[-1]) > freedom(search, number)
        if more and alike > form and not related:
            continue  # the same with more freedom, which it does not need
        if lead <= (needed_of_kin if related else needed):
            members.append(other.family)
    members += same_as(
        search, [rival for rival, _ in rivals], members, needed, method.alike_correlation
    )
    evidence = search.evidence
    columns = [projection.options[i].columns for i in rest.options]
    before = np.concatenate([evidence.free, *columns], axis=2)
    held_out, names = held_out_gains(evidence, search.whitener, before, own.columns)
    runner_up = projection.options[rivals[0][0].options[-1]].family if rivals else None
    closest = runner_up is not None and kin(own.family, runner_up)
    return Judged(
        option=own,
        score=score,
        threshold=threshold,
        null=null,
        held_out=held_out,
        fold_names=names,
        runner_up=runner_up,
        margin=choice.gain - rivals[0][0].gain if rivals else score,
        needed=needed_of_kin if closest else needed,
        correlation=rivals[0][1] if rivals else 0.0,
        members=tuple(members),
        visibility=float(projection.visibility[number]),
        strength=strength(search, number, score),
    )
