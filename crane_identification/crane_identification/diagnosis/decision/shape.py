"""The physics of an effect before its law: what any shape with its signature explains.

A machine has a family of laws where the catalogue has one. So an effect that the race found is
asked beside others with its shape left free: a further effect has to explain what no shape of the
first one does, one whose signature the catalogue does not know is no name at all, and where no law
fits, the shape is kept as it was drawn.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.stats import chi2

from crane_identification.diagnosis.decision.bend import likelier
from crane_identification.diagnosis.decision.cross_validation import Folds, held_out_gains, helps
from crane_identification.diagnosis.decision.judgement import (
    Judged,
    all_judged,
    folds_asked,
    found_values,
    marginal,
)
from crane_identification.diagnosis.decision.likeness import in_place_of, same_effect, without
from crane_identification.diagnosis.search.candidates import Candidate, ShapedCandidate
from crane_identification.diagnosis.search.energy import explained, strength, unexplained_beside
from crane_identification.diagnosis.search.race import Race
from crane_identification.diagnosis.search.search import Search
from crane_identification.diagnosis.search.selection import NOTHING, Subset, solve
from crane_identification.diagnosis.search.shapes import ForceSignature, shape_of
from crane_identification.thresholds import Thresholds


def covered(search: Search, subset: Subset, thresholds: Thresholds, settled: int = 0) -> bool:
    """Whether an effect of a set explains little that a stronger one on its joint would not explain
    with some other shape or, where both are of one signature or laws of the same effect, does not
    by itself. The first ones, `settled`, are not asked.
    """
    gains, share = marginal(search, subset), thresholds.method.form_share
    found = _candidates(search, subset)
    for place, own in list(enumerate(found))[settled:]:
        rest = [one.columns for one in found if one is not own]
        for number, first, gain in zip(subset.numbers, found, gains, strict=True):
            if first is own or first.candidate.joint != own.candidate.joint or gain < gains[place]:
                continue
            shaped = search.shapes.of(first.candidate)
            if _alike(own.candidate, first.candidate):
                alone = solve(search.projection, (number,)) or NOTHING
                more, asked = gains[place], share * alone.gain
            elif shaped is None:
                continue
            else:
                more = explained(search, *rest, shaped.columns, own.columns)
                more -= explained(search, *rest, shaped.columns)
                asked = share * gains[place]
            if more < asked:
                return True
    return False


def _alike(one: Candidate, other: Candidate) -> bool:
    """Whether two effects on one joint have one signature, or are laws of the same effect."""
    cls = shape_of(one)
    return same_effect(one, other) or (cls is not None and cls is shape_of(other))


def rival(
    search: Search, subset: Subset, place: int, thresholds: Thresholds
) -> ForceSignature | None:
    """The signature that explains most of what one effect of a set does, and clearly more than any
    shape of it, also of recordings that it is not fitted to; None if there is none.
    """
    own = _candidates(search, subset)[place]
    if own.candidate.joint is None or own.candidate.changes:
        return None
    rest = [one.columns for one in _candidates(search, without(search, subset, place))]
    shaped = search.shapes.of(own.candidate)
    free = [own.columns, *([] if shaped is None else [shaped.columns])]
    before = np.concatenate([search.evidence.free, *rest, *free], axis=2)
    known = explained(search, *rest, *free)
    least = thresholds.method.lead_share * unexplained_beside(search, subset, place)
    best, most = None, known
    for other in signatures(search, own.candidate.joint):
        if own.candidate.type in (*other.types, *other.term.holds):
            continue
        if not other.types and other.term.is_of_sensors():
            continue  # beside any effect: asked for in the end
        reached = explained(search, *rest, other.columns)
        if reached - known <= max(least, chance_of(other.columns, thresholds)) or reached <= most:
            continue
        gains, _ = held_out_gains(search.evidence, search.whitener, before, other.columns)
        if helps(gains, thresholds):
            best, most = other, reached
    return best


def of_better_signature(
    search: Search, subset: Subset, thresholds: Thresholds, settled: int = 0
) -> tuple[Subset, list[str]]:
    """The set with effects replaced by those whose signature is clearly better, and signatures that
    are better but those of no effect, in words. The first effects, `settled`, are not asked.
    """
    strange = []
    for place in range(settled, len(subset.numbers)):
        other = rival(search, subset, place, thresholds)
        if other is not None:
            better = _with_law_of(search, subset, place, other.types)
            if better is None:
                strange.append(f"{other.said} explains clearly more than any shape of it")
            elif _holds(search, subset, place, better, thresholds):
                subset = better
    return subset, strange


def _holds(
    search: Search, subset: Subset, place: int, better: Subset, thresholds: Thresholds
) -> bool:
    """Whether a law in the place of an effect explains most of what that does: a signature whose
    law does not is of another force, which it can be bent to.
    """
    least = thresholds.method.simple_share
    known = without(search, subset, place).gain
    return better.gain - known >= least * (subset.gain - known)


def _with_law_of(search: Search, subset: Subset, place: int, types: Sequence[str]) -> Subset | None:
    """The set with the best law of these types in the place of an effect, if there is one."""
    joint = _candidates(search, subset)[place].candidate.joint
    for swapped in in_place_of(search, subset, place):
        law = search.projection.candidates[swapped.numbers[-1]].candidate
        if law.type in types and law.joint == joint:
            numbers = list(subset.numbers)
            numbers[place] = swapped.numbers[-1]
            return solve(search.projection, tuple(numbers))
    return None


def as_drawn(race: Race, passed: Sequence[Judged], thresholds: Thresholds) -> tuple[Judged, ...]:
    """The effects under the law where they bend, those that no law fits with the shape that was
    drawn.

    They passed with the law that fits best: beside one that fits less, others are blurred.
    """
    out, search = list(passed), race.search
    subset = (
        solve(search.projection, tuple(search.number(one.shaped) for one in out)) if out else None
    )
    for place, one in enumerate(out):
        shaped = search.shapes.of(one.shaped.candidate)
        if shaped is not None and subset is not None:
            rest = [other.shaped.columns for other in out if other is not one]
            laws = likelier(search, one.shaped.candidate, rest)
            named = _with_law_of(search, subset, place, laws[:1])
            if named is not None:
                subset, one = named, all_judged(search, named, thresholds)[place]
                shaped = search.shapes.of(one.shaped.candidate) or shaped
            left = unexplained_beside(search, subset, place)
            asked = folds_asked(search, one.shaped, found_values(search, subset, place))
            out[place] = _better(race, one, shaped, rest, left, asked, thresholds)
    return tuple(out)


def _better(
    race: Race,
    law: Judged,
    shaped: ShapedCandidate,
    rest: Sequence[np.ndarray],
    left: float,
    asked: Folds,
    thresholds: Thresholds,
) -> Judged:
    """The effect with its law or, if that explains clearly more in training and of recordings that
    it is not fitted to, with its drawn shape, beside the `rest` (n, c, k each).

    Clearly more is much of what the law explains or, of an effect that is so strong that this says
    little, of what is `left` where it acts. `asked` are the folds in which the law is.
    """
    search, method = race.search, thresholds.method
    lead = explained(search, *rest, shaped.columns) - explained(search, *rest, law.shaped.columns)
    least = min(method.further_share * law.score, method.kin_lead_share * left)
    if lead <= max(least, chance_of(shaped.columns, thresholds)):
        return law
    before = np.concatenate([search.evidence.free, *rest], axis=2)
    beside_law = np.concatenate([before, law.shaped.columns], axis=2)
    gains, _ = held_out_gains(search.evidence, search.whitener, beside_law, shaped.columns, asked)
    if np.nansum(gains) <= chance_of(shaped.columns, thresholds):
        return law
    number = race.add(shaped)
    search = race.search
    held_out, names = held_out_gains(
        search.evidence, search.whitener, before, shaped.columns, asked
    )
    score = law.score + lead
    known = law.shaped.candidate
    alike = [
        other.candidate
        for other in law.rivals
        if other.lead + lead <= other.needed and not _told(search, known, other.candidate, rest)
    ]
    return replace(
        law,
        shaped=shaped,
        score=score,
        held_out=held_out,
        fold_names=names,
        margin=law.margin + lead,
        indistinct=tuple(alike),
        visibility=float(search.projection.visibility[number]),
        strength=strength(search, number, score),
    )


def _told(search: Search, law: Candidate, other: Candidate, rest: Sequence[np.ndarray]) -> bool:
    """Whether a law is told from another one of its shape, which their lead cannot do."""
    return law.joint == other.joint and law.type in likelier(search, other, rest)


def signatures(search: Search, joint: str) -> list[ForceSignature]:
    """Those on a joint: of effects that can be told from the model, and of no effect."""
    own = [one.candidate for one in search.projection.candidates if one.candidate.joint == joint]
    laws = {shape_of(one): one for one in reversed(own) if not one.drawn}
    shaped = ((cls, search.shapes.of(law)) for cls, law in laws.items() if cls is not None)
    known = [
        ForceSignature(cls.said, cls.draws, one.term, one.columns)
        for cls, one in shaped
        if one is not None
    ]
    return [*known, *search.shapes.strangers(joint)]


def _candidates(search: Search, subset: Subset) -> list[ShapedCandidate]:
    return [search.projection.candidates[number] for number in subset.numbers]


def chance_of(columns: np.ndarray, thresholds: Thresholds) -> float:
    """What chance gives to so many columns (n, c, k) at most, times what the sensor chain adds."""
    level = 1.0 - thresholds.method.false_alarm_rate / 2.0
    return thresholds.gates.score_factor * float(chi2.ppf(level, columns.shape[2]))
