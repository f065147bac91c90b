"""An effect weighed against chance, held-out recordings and others in its place."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from crane_identification.diagnosis.decision.chance import by_chance
from crane_identification.diagnosis.decision.cross_validation import (
    Folds,
    folds,
    folds_of,
    held_out_gains,
)
from crane_identification.diagnosis.decision.likeness import (
    freedom,
    in_place_of,
    likeness,
    same_as,
    same_effect,
    without,
)
from crane_identification.diagnosis.search.candidates import Candidate, ShapedCandidate
from crane_identification.diagnosis.search.energy import strength, unexplained_beside
from crane_identification.diagnosis.search.search import Search
from crane_identification.diagnosis.search.selection import Subset
from crane_identification.thresholds import Thresholds

BETWEEN = {"time", "recording"}  # by which recordings differ
IDENTICAL_CORRELATION = 1.0 - 1e-6
"""Above it, beside the model, an effect is the other one by another name."""


class Rival(NamedTuple):
    """Another effect in the place of one that has so much `lead`, where `needed` is asked for."""

    candidate: Candidate
    lead: float
    needed: float


@dataclass(frozen=True)
class Judged:
    """An effect that was weighed against chance, held-out recordings and others in its place.

    `score`: 2 dlogL that the set loses without it; `threshold` and `null` (replicates,) of the best
    score when nothing is missing; `held_out` gains of the folds `fold_names`. `runner_up`: the best
    candidate in its place, `margin` behind by, where `needed` is asked for; `indistinct`: all that
    cannot be told from it; `rivals`: all that are not but the same with more freedom. `strength`:
    rms of what it explains over that of its joint's force; `correlation` of the runner-up's columns
    with its own, beside the model.
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
    rivals: tuple[Rival, ...] = ()


def all_judged(search: Search, subset: Subset, thresholds: Thresholds) -> list[Judged]:
    """The effects of a set, each against what chance adds to the best smaller set."""
    null, threshold = by_chance(search, search.sets[len(subset.numbers) - 1][0], thresholds)
    return [
        _judged(search, subset, place, score, threshold, null, thresholds)
        for place, score in enumerate(marginal(search, subset))
    ]


def marginal(search: Search, subset: Subset) -> list[float]:
    """What the set loses without each of its effects."""
    places = range(len(subset.numbers))
    return [subset.gain - without(search, subset, place).gain for place in places]


def found_values(search: Search, subset: Subset, place: int) -> np.ndarray:
    """The parameters (k,) that a set gives to one of its effects."""
    projection = search.projection
    counts = [len(projection.columns_of[number]) for number in subset.numbers]
    begin, own = sum(counts[:place]), projection.columns_of[subset.numbers[place]]
    return np.asarray(subset.values[begin : begin + counts[place]] / projection.scale[own])


def folds_asked(search: Search, own: ShapedCandidate, values: np.ndarray) -> Folds:
    """Where an effect with these values (k,) is asked to help: where it acts; or everywhere, if it
    follows the time or the recording, since one recording that differs would look like it.
    """
    if BETWEEN & set(own.candidate.effect.follows):
        return folds(search.evidence)
    return folds_of(search.evidence, search.whitener, own.columns @ values)


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
    left = unexplained_beside(search, subset, place)
    # Beyond noise, what is left unexplained, and columns that are not quite those of the machine.
    needed = max(threshold, method.lead_share * left, (1.0 - method.alike_correlation**2) * score)
    needed_of_same = max(needed, method.kin_lead_share * left)
    rivals: list[Rival] = []
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
        rivals.append(Rival(other.candidate, lead, needed_of_same if related else needed))
    indistinct = [one.candidate for one in rivals if one.lead <= one.needed]
    indistinct += same_as(
        search, [swapped for swapped, _ in swaps], indistinct, needed, method.alike_correlation
    )
    evidence = search.evidence
    columns = [projection.candidates[i].columns for i in rest.numbers]
    before = np.concatenate([evidence.free, *columns], axis=2)
    found = found_values(search, subset, place)
    asked = folds_asked(search, own, found)
    acting = own.columns[:, :, found != 0.0]
    held_out, names = held_out_gains(evidence, search.whitener, before, acting, asked)
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
        rivals=tuple(rivals),
    )
