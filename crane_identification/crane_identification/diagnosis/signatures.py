"""Signatures of forces, drawn as nonparametric curves beside the model forms of the catalogue.

A machine has a family of forms where the catalogue has one. An effect that the forward selection
found is therefore compared with its own curve and with the curves of other signatures.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from crane_identification.diagnosis.candidates import Candidate, ShapedCandidate
from crane_identification.diagnosis.constants import FAMILY_LEAD_SHARE, LITTLE_SHARE, SLIGHT_SHARE
from crane_identification.diagnosis.evidence import TINY, beside, leading, least_squares
from crane_identification.diagnosis.judgement import (
    Judged,
    Reason,
    Rejection,
    all_judged,
    chance_of,
    folds_asked,
    found_values,
    held_out_gains,
    in_place_of,
    predicts,
    with_other,
    without,
)
from crane_identification.diagnosis.projection import Subset
from crane_identification.diagnosis.search import ForceSignature, Search, shape_of
from crane_identification.diagnosis.selection import ForwardSelection
from crane_identification.diagnosis.several import as_kinds
from crane_model.terms.nonparametric import NonparametricTerm

# Which law of one signature an effect follows, told by how its shape bends and whether it falls.
#
# Friction that falls with the speed and a loss that rises beyond it are both bent upwards. Beside
# Coulomb and viscous friction, a law of the one that is not quite the machine's may fit the other.
# So families of curves are compared, not laws: the shape follows one of the right family closely.
# But friction that has fallen is still there, of which a law that falls leaves nothing, or less,
# where a strong loss bends.


def likelier(search: Search, law: Candidate, rest: Sequence[np.ndarray]) -> tuple[str, ...]:
    """Types of the laws a curve of whose family explains clearly more than any of that of `law`,
    beside the `rest` (n, c, k each), and which fall where friction does, best first; none where the
    shape does not tell. Those of a falling `law` that leaves no friction need not explain more.
    """
    cls, shaped = shape_of(law), search.shapes.of(law)
    if cls is None or shaped is None or law.type not in cls.families:
        return ()
    friction = _friction(search, shaped, rest, cls)
    if friction is None:
        return ()
    speed, fallen, gone = friction
    falls = fallen > SLIGHT_SHARE and not gone
    own = search.beside(shaped.columns)
    if rest:
        others = search.beside(*rest)
        own = beside(leading(others, others.shape[1]), own)
    gram, score, gains = own.T @ own, own.T @ search.base.residual, dict[str, float]()
    for kind in cls.families:
        if kind == law.type or (kind in cls.falling) == falls:
            curves = cls.family_of(kind, speed)  # of more friction, not of less
            power = np.maximum(np.einsum("km,kl,lm->m", curves, gram, curves), TINY)
            gains[kind] = float((np.maximum(curves.T @ score, 0.0) ** 2 / power).max())
    known = (1.0 + FAMILY_LEAD_SHARE) * gains.pop(law.type)
    least = -np.inf if law.type in cls.falling and gone else known
    better = [kind for kind, gain in gains.items() if gain > least]
    return tuple(sorted(better, key=lambda kind: -gains[kind]))


def _friction(
    search: Search,
    shaped: ShapedCandidate,
    rest: Sequence[np.ndarray],
    cls: type[NonparametricTerm],
) -> tuple[np.ndarray, float, bool] | None:
    """The speeds (knots,) of a shape; by how much friction falls with the speed at most, over the
    height of the shape; and whether none is left, by the straight line that ends it. None if the
    model has no terms for the slope and the height of the shape.
    """
    evidence, joint = search.evidence, shaped.candidate.joint
    terms = {one.type: one for one in evidence.model.terms if one.only_joint == joint}
    own = [terms[kind] for kind in (cls.slope_of, cls.height_of) if kind in terms]
    if evidence.keeps or len(own) < 2:
        return None
    columns = np.concatenate([evidence.free, *rest, shaped.columns], axis=2)
    values = least_squares(search.whitener(columns), search.whitener(evidence.force))
    (curve,) = shaped.term.curves(values[-shaped.columns.shape[2] :])
    slope, height = (values[evidence.model.part(one)][0] for one in own)
    speed = np.array(curve.knots)
    friction = height + slope * speed + curve.values
    fall = (np.maximum.accumulate(friction) - friction).max()
    ends = [cls.straight_from, -1]
    left = np.polyfit(speed[ends], friction[ends], 1)[-1]
    gone = bool(left < LITTLE_SHARE * max(friction[0], 0.0))
    return speed, float(fall / max(np.ptp(curve.values), TINY)), gone


# An effect and its nonparametric curve: an effect is rejected if a signature explains more that the
# catalogue does not know; and if no model form fits, the curve is kept.


def of_better_signature(
    search: Search, subset: Subset, settled: int = 0
) -> tuple[Subset, list[Rejection]]:
    """The set with laws of clearly better signatures, and rejections by unlisted ones."""
    strange = []
    for place in range(settled, len(subset.numbers)):
        other = _rival(search, subset, place)
        if other is not None:
            better = _with_law_of(search, subset, place, other.types)
            known = without(search, subset, place).gain
            most = search.thresholds.method.simple_share * (subset.gain - known)
            if better is None:
                strange.append(Rejection(Reason.SIGNATURE, about=(other.said,)))
            elif better.gain - known >= most:
                subset = better
    return subset, strange


def _rival(search: Search, subset: Subset, place: int) -> ForceSignature | None:
    """The signature that explains clearly more than any curve of an effect, also held out."""
    candidates = search.projection.candidates
    own = candidates[subset.numbers[place]]
    if own.candidate.joint is None or own.candidate.changes:
        return None
    rest = [candidates[i].columns for i in without(search, subset, place).numbers]
    shaped = search.shapes.of(own.candidate)
    free = [own.columns, *([] if shaped is None else [shaped.columns])]
    known = search.explained(*rest, *free)
    least = search.thresholds.method.lead_share * search.unexplained_beside(subset, place)
    best, most = None, known
    for other in signatures(search, own.candidate.joint):
        if own.candidate.type in (*other.types, *other.term.holds):
            continue
        if not other.types and other.term.is_of_sensors():
            continue  # beside any effect: asked for in the end
        reached = search.explained(*rest, other.columns)
        clear = reached - known > max(least, chance_of(search, other.columns))
        if clear and reached > most and predicts(search, [*rest, *free], other.columns):
            best, most = other, reached
    return best


def _with_law_of(search: Search, subset: Subset, place: int, types: Sequence[str]) -> Subset | None:
    """The set with the best law of these types in the place of an effect, if there is one."""
    candidates = search.projection.candidates
    joint = candidates[subset.numbers[place]].candidate.joint
    for swapped in in_place_of(search, subset, place) if types else ():
        law = candidates[swapped.numbers[-1]].candidate
        if law.type in types and law.joint == joint:
            return with_other(search, subset, place, swapped.numbers[-1])
    return None


def as_drawn(selection: ForwardSelection, passed: Sequence[Judged]) -> tuple[Judged, ...]:
    """The effects under the law whose curves fit best, or with the curve if no law fits."""
    out, search = list(passed), selection.search
    subset = search.together(one.shaped for one in out)
    for place, one in enumerate(out):
        shaped = search.shapes.of(one.shaped.candidate)
        if shaped is not None and subset.numbers:
            rest = [other.shaped.columns for other in out if other is not one]
            laws = likelier(search, one.shaped.candidate, rest)
            named = _with_law_of(search, subset, place, laws[:1])
            if named is not None:
                subset, one = named, all_judged(search, named)[place]
                shaped = search.shapes.of(one.shaped.candidate) or shaped
            out[place] = _better(selection, subset, place, one, shaped, rest)
    return tuple(out)


def _better(
    selection: ForwardSelection,
    subset: Subset,
    place: int,
    law: Judged,
    shaped: ShapedCandidate,
    rest: Sequence[np.ndarray],
) -> Judged:
    """The effect with its law or, if that explains clearly more also held out, its curve."""
    search, method = selection.search, selection.search.thresholds.method
    lead = search.explained(*rest, shaped.columns) - search.explained(*rest, law.shaped.columns)
    left, chance = search.unexplained_beside(subset, place), chance_of(search, shaped.columns)
    if lead <= max(min(method.further_share * law.score, method.kin_lead_share * left), chance):
        return law
    asked = folds_asked(search, law.shaped, found_values(search, subset, place))
    gains, _ = held_out_gains(search, [*rest, law.shaped.columns], shaped.columns, asked)
    if np.nansum(gains) <= chance:
        return law
    number = selection.add(shaped)
    search = selection.search
    held_out, names = held_out_gains(search, rest, shaped.columns, asked)
    score, known = law.score + lead, law.shaped.candidate
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
        strength=search.strength(number, score),
    )


def _told(search: Search, law: Candidate, other: Candidate, rest: Sequence[np.ndarray]) -> bool:
    """Return whether a law is told from another one of its curve, which their lead cannot do."""
    return law.joint == other.joint and law.type in likelier(search, other, rest)


def signatures(search: Search, joint: str) -> list[ForceSignature]:
    """Signatures on a joint: of effects that can be told from the model, and of no effect."""
    own = [one.candidate for one in search.projection.candidates if one.candidate.joint == joint]
    laws = {shape_of(one): one for one in reversed(own) if not one.drawn}
    shaped = ((cls, search.shapes.of(law)) for cls, law in laws.items() if cls is not None)
    known = [
        ForceSignature(cls.said, cls.draws, one.term, one.columns)
        for cls, one in shaped
        if one is not None
    ]
    return [*known, *search.shapes.unlisted_signatures(joint)]


# The selection beside shapes that were drawn: if no law fits an effect, what its law leaves hides a
# weaker one. Its shape leaves nothing: further effects are sought beside it.


def start_beside(selection: ForwardSelection, passed: Sequence[Judged]) -> bool:
    """Let the selection go on from effects if some were drawn; return whether it does."""
    if not any(one.shaped.candidate.drawn for one in passed):
        return False
    start = selection.search.together(one.shaped for one in passed)
    if not start.numbers:
        return False
    selection.go_on_from(start)
    return True


def best_beside(selection: ForwardSelection, size: int, settled: Sequence[Judged]) -> Subset | None:
    """The best set of so many effects without another law of a curve that is `settled`."""
    drawn = [one.shaped.candidate for one in settled if one.shaped.candidate.drawn]
    if not drawn:
        return selection.best(size)
    known = {(one.joint, shape_of(one)) for one in drawn}
    for subset in selection.sets(size):
        further = [
            selection.search.projection.candidates[number].candidate
            for number in subset.numbers[len(settled) :]
        ]
        if not any((one.joint, shape_of(one)) in known for one in further):
            return subset
    return None


def judged_beside(search: Search, subset: Subset, settled: Sequence[Judged]) -> list[Judged]:
    """The effects of a set; `settled` ones are judged as kinds or stay if one was drawn."""
    found, known = all_judged(search, subset), len(settled)
    if any(one.shaped.candidate.drawn for one in settled):
        stay = [
            old if old.shaped.candidate == new.shaped.candidate else new
            for old, new in zip(settled, found[:known], strict=True)
        ]
        return [*stay, *found[known:]]
    return as_kinds(search, found, known)
