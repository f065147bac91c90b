"""Which of the sets that the search found are findings, and which rivals each has."""

from dataclasses import dataclass

import numpy as np

from crane_identification.discrepancy.candidates import Family, Option
from crane_identification.discrepancy.cross_validation import held_out_gains
from crane_identification.discrepancy.null import null_gains
from crane_identification.discrepancy.rivals import (
    freedom,
    in_place_of,
    kin,
    likeness,
    same_as,
    slight,
    without,
)
from crane_identification.discrepancy.search import LARGEST_SET, Search
from crane_identification.discrepancy.selection import NOTHING, Choice, solve
from crane_identification.discrepancy.strength import strength
from crane_identification.discrepancy.thresholds import Thresholds

DISTINCT = 0.9
"""Correlation beside the model below which the columns of two effects are different."""
RELATED = 0.2
"""Correlation below which an effect is no rival: it explains something else."""
KIN_SHARE = 0.5
"""Share of an effect's score by which it must lead another law of the same effect."""
FOLDS_TO_FAIL = 4
"""Folds of which one may fail, whatever share is asked for."""
SAME_FORM = 0.9
"""Correlation above which one effect is taken for a special case of the other."""


@dataclass(frozen=True)
class Accepted:
    """An effect that the data ask for.

    `score`: 2 dlogL that the set loses without it; `threshold` and `null` (replicates,) of the best
    score when nothing is missing; `held_out` gains of the folds `fold_names`. `runner_up`: the best
    family in its place, `margin` behind by; `members`: all families that cannot be told from it.
    `strength`: rms of what it explains over that of its joint's force; `correlation` of the
    runner-up's columns with its own, beside the model.
    """

    option: Option
    score: float
    threshold: float
    null: np.ndarray
    held_out: np.ndarray
    fold_names: tuple[str, ...]
    runner_up: Family | None
    margin: float
    correlation: float
    members: tuple[Family, ...]
    visibility: float
    strength: float


def decide(search: Search, thresholds: Thresholds) -> tuple[list[Accepted], float]:
    """The largest set all of whose effects pass, strongest first; and the first threshold."""
    accepted: list[Accepted] = []
    first_threshold = _threshold(_null(search, NOTHING), thresholds)
    for size in range(1, LARGEST_SET + 1):
        best = search.best(size)
        if best is None:
            break
        choice = _simplest(search, best, thresholds, first_threshold)
        null = _null(search, search.sets(size - 1)[0])
        marginal = _marginal(search, choice)
        threshold = _threshold(null, thresholds)
        weakest = int(np.argmin(marginal))
        if marginal[weakest] <= threshold:
            break
        if slight([search.channels(number) for number in choice.options], marginal, thresholds):
            break
        found = [
            _judged(search, choice, place, marginal[place], threshold, null, thresholds)
            for place in range(size)
        ]
        if any(not _passes(one, thresholds) for one in found):
            break
        if size > 1 and _vague(found[weakest]):
            break
        accepted = sorted(found, key=lambda one: -one.score)
    return accepted, first_threshold


def _passes(one: Accepted, thresholds: Thresholds) -> bool:
    return helps(one.held_out, thresholds) and one.strength >= thresholds.smallest_strength


def helps(gains: np.ndarray, thresholds: Thresholds) -> bool:
    """Whether an effect improves the prediction of recordings that it was not fitted to.

    In all folds (NaN: not asked) but a few; of four and more, one may differ in something else.
    Folds are counted: how much one of them gains or loses decides nothing.
    """
    asked = gains[np.isfinite(gains)]
    failed = int((asked <= 0.0).sum())
    allowed = max((1.0 - thresholds.folds_share) * len(asked), float(len(asked) >= FOLDS_TO_FAIL))
    return 2 * len(asked) > len(gains) and failed <= allowed


def _vague(one: Accepted) -> bool:
    """Whether a further effect is no better than others that look different.

    That is what remains where the first one has another form than the catalogue gives it.
    """
    return bool(one.members) and one.correlation < DISTINCT


def _null(search: Search, before: Choice) -> np.ndarray:
    members = search.projection.members
    inside = [int(c) for i in before.options for c in members[i]]
    return null_gains(search.projection, inside)


def _threshold(null: np.ndarray, thresholds: Thresholds) -> float:
    return thresholds.score_factor * float(
        np.quantile(null, 1.0 - thresholds.false_alarm_rate / 2.0)
    )


def _simplest(search: Search, choice: Choice, thresholds: Thresholds, threshold: float) -> Choice:
    """The set with effects replaced by simpler ones that they are no better than.

    Presliding over no way and a Stribeck curve without end are Coulomb friction.
    """
    for place in range(len(choice.options)):
        own = choice.options[place]
        needed = _needed(search, choice, place, thresholds, threshold)
        for rival in in_place_of(search, choice, place):
            other = rival.options[-1]
            if choice.gain - rival.gain > needed:
                break
            if freedom(search, other) < freedom(search, own) and _same(search, own, other):
                order = (*choice.options[:place], other, *choice.options[place + 1 :])
                choice = solve(search.projection, order) or choice
                break
    return choice


def _needed(
    search: Search, choice: Choice, place: int, thresholds: Thresholds, threshold: float
) -> float:
    """Lead by which effects are told apart: beyond noise, and beyond what is left unexplained
    where the effect acts.
    """
    left = search.unexplained(choice)[search.channels(choice.options[place])].sum()
    return max(threshold, thresholds.lead_share * max(float(left), 0.0))


def _same(search: Search, one: int, other: int) -> bool:
    return likeness(search, one, other) > SAME_FORM


def _marginal(search: Search, choice: Choice) -> list[float]:
    """What the set loses without each of its effects."""
    places = range(len(choice.options))
    return [choice.gain - without(search, choice, place).gain for place in places]


def _judged(
    search: Search,
    choice: Choice,
    place: int,
    score: float,
    threshold: float,
    null: np.ndarray,
    thresholds: Thresholds,
) -> Accepted:
    projection = search.projection
    number = choice.options[place]
    own = projection.options[number]
    rest = without(search, choice, place)
    rivals = [
        (rival, alike)
        for rival in in_place_of(search, choice, place)
        if (alike := likeness(search, number, rival.options[-1])) > RELATED
        or kin(own.family, projection.options[rival.options[-1]].family)
    ]
    needed = _needed(search, choice, place, thresholds, threshold)
    members, correlation = [], rivals[0][1] if rivals else 0.0
    for rival, alike in rivals:
        other = projection.options[rival.options[-1]]
        lead = choice.gain - rival.gain
        if kin(own.family, other.family):
            if lead < KIN_SHARE * score:
                members.append(other.family)
            continue
        more = bool(other.shape) and freedom(search, rival.options[-1]) > freedom(search, number)
        if more and alike > SAME_FORM:
            continue  # the same with more freedom, which it does not need
        # What is but a part of the effect's columns may look alike and explain less.
        whole = len(other.positive) >= len(own.positive)
        if lead <= needed or (whole and alike > thresholds.alike):
            members.append(other.family)
    members += same_as(search, [rival.options[-1] for rival, _ in rivals], members, thresholds)
    evidence = search.evidence
    columns = [projection.options[i].columns for i in rest.options]
    before = np.concatenate([evidence.base, *columns], axis=2)
    held_out, names = held_out_gains(evidence, search.whitener, before, own.columns)
    return Accepted(
        option=own,
        score=score,
        threshold=threshold,
        null=null,
        held_out=held_out,
        fold_names=names,
        runner_up=projection.options[rivals[0][0].options[-1]].family if rivals else None,
        margin=choice.gain - rivals[0][0].gain if rivals else score,
        correlation=correlation,
        members=tuple(members),
        visibility=float(projection.visibility[number]),
        strength=strength(search, number, score),
    )
