"""Forces that resemble an effect of the catalogue and are not one."""

from collections.abc import Collection, Sequence

import numpy as np

from crane_identification.diagnosis.candidates import ShapedCandidate
from crane_identification.diagnosis.judgement import (
    Beyond,
    Judged,
    held_out_gains,
    helps,
    marginal,
    without,
)
from crane_identification.diagnosis.projection import Subset
from crane_identification.diagnosis.search import (
    ForceSignature,
    Search,
    beside_lengths,
    channels,
    explained,
    gained,
    strength_on,
    unexplained,
    unexplained_on_joints,
)
from crane_identification.diagnosis.several import factors
from crane_identification.diagnosis.signatures import chance_of
from crane_identification.thresholds import Thresholds

# Whether a further effect, however weak, is none of what stronger ones leave over.
#
# A law that is not quite the machine's leaves a share of its own force, which a further effect may
# resemble. How much that is, is known where the shape of the stronger one can be drawn: a shape
# that explains no more than the law, in training and of recordings that it was not fitted to, says
# that the law is the machine's, and leaves nothing.


def stands_apart(
    search: Search,
    subset: Subset,
    gains: Sequence[float],
    place: int,
    chance: float,
    thresholds: Thresholds,
) -> bool:
    """Return whether one effect of a set explains beside any curve of the stronger ones what it
    does beside their model forms, more than `chance` and of recordings that it was not fitted to;
    and each of these forms leaves nothing to its curve.
    """
    found = [search.projection.candidates[number] for number in subset.numbers]
    own, rest = found[place], [one for k, one in enumerate(found) if k != place]
    stronger = [
        one
        for one, gain in zip(found, gains, strict=True)
        if one is not own and gain > gains[place] and not one.candidate.effect.formless
    ]
    shapes = [search.shapes.of(one.candidate) for one in stronger]
    drawn = [shape for shape in shapes if shape is not None]
    if len(drawn) < len(stronger):
        return False
    if not all(
        _is_the_machines(search, found, law, shape, thresholds)
        for law, shape in zip(stronger, drawn, strict=True)
    ):
        return False
    known = [one.columns for one in (*rest, *drawn)]
    least = max(chance, thresholds.method.simple_share * gains[place])
    if gained(search, known, own.columns) <= least:
        return False
    return helps(held_out_gains(search, known, own.columns)[0], thresholds)


def _is_the_machines(
    search: Search,
    found: Sequence[ShapedCandidate],
    law: ShapedCandidate,
    shape: ShapedCandidate,
    thresholds: Thresholds,
) -> bool:
    """Return whether a curve explains no more than chance beside all that was `found`."""
    if law.candidate.drawn:
        return True
    columns = [one.columns for one in found]
    limit = chance_of(shape.columns, thresholds)
    if gained(search, columns, shape.columns) > limit:
        return False
    gains, _ = held_out_gains(search, columns, shape.columns)
    return bool(np.nansum(gains) <= limit)


# Whether a further effect is but the form of another one, which its law leaves over.


def slight(
    channels: Sequence[np.ndarray],
    gains: Sequence[float],
    share: float,
    asked: Collection[int],
    formless: Collection[int] = (),
) -> bool:
    """Return whether one of the effects `asked` gains less than this share of the gain of another
    one that has a form, in one of its channels: the form of the other one may leave as much.
    """
    where = [set(one.tolist()) for one in channels]
    return any(
        gains[place] < share * gains[k]
        for place in asked
        for k in range(len(where))
        if k not in formless and where[place] & where[k]
    )


def of_one_form(
    search: Search, subset: Subset, chance: float, thresholds: Thresholds, settled: int = 0
) -> bool:
    """Return whether an effect of a set, after the first `settled`, is only the rest that the form
    of another one leaves. `chance`: gain of the best effect if nothing is missing.
    """
    if all(search.projection.candidates[number].candidate.changes for number in subset.numbers):
        return False
    gains = marginal(search, subset)
    effects = [search.projection.candidates[number].candidate.effect for number in subset.numbers]
    formless = {place for place, effect in enumerate(effects) if effect.formless}
    where = [channels(search, number) for number in subset.numbers]
    return any(
        slight(where, gains, thresholds.method.further_share, (place,), formless)
        and not fills(search, subset, place, chance, thresholds)
        and not stands_apart(search, subset, gains, place, chance, thresholds)
        for place in range(settled, len(gains))
    )


def fills(
    search: Search, subset: Subset, place: int, chance: float, thresholds: Thresholds
) -> bool:
    """Return whether one effect of a set explains most of what the others leave beyond noise where
    it acts, which is more than `chance`.
    """
    own = channels(search, subset.numbers[place])
    before, after = (
        float(unexplained(search, one)[own].sum())
        for one in (without(search, subset, place), subset)
    )
    return before > chance and after <= (1.0 - thresholds.method.simple_share) * before


# Forces of no effect of the catalogue, beside the effects that were found or in their place.
#
# What a law leaves because it is not quite the machine's follows no signature well. So a signature
# of no effect is there if it is most of what is left on a joint, as much beside the laws there as
# is asked of an effect, and predicts it elsewhere.

# Forces that wrong lengths leave: a little on every joint, often too weak to be named. A force that
# explains little beside such lengths is not an effect.


def is_of_lengths(
    search: Search, rest: Sequence[np.ndarray], columns: np.ndarray, thresholds: Thresholds
) -> bool:
    """Return whether columns (n, c, k), beside the `rest`, gain less than half as much beside
    lengths that are off and scales of all joints' forces.
    """
    longer = beside_lengths(search)
    scales = [longer.projection.candidates[number].columns for number in factors(longer)]
    share = thresholds.method.simple_share
    return gained(longer, [*rest, *scales], columns) < share * gained(search, rest, columns)


SENSING = "sensing"  # family of terms


def with_strange(
    search: Search, found: Sequence[Judged], threshold: float, thresholds: Thresholds
) -> tuple[tuple[Judged, ...], tuple[Beyond, ...]]:
    """What was found, without effects in whose place a signature of no effect explains more, and
    these signatures. `threshold` is what chance gives to the best effect of the catalogue.
    """
    kept, beyond = list(found), []
    subset = search.together(one.shaped for one in found)
    joints = search.evidence.joints
    left = unexplained_on_joints(search, subset)
    for j, joint in enumerate(joints):
        least = max(
            threshold,
            thresholds.method.simple_share * float(left[j]),
            _left_by_form(found, joint, thresholds),
        )
        other = _most_of(search, found, j, least, thresholds)
        if other is not None:
            beyond.append(Beyond(joint, other.said))
            kept = [
                one
                for one in kept
                if one.shaped.candidate.joint != joint or not _instead(search, found, one, other)
            ]
    return tuple(kept), tuple(beyond)


def _most_of(
    search: Search, found: Sequence[Judged], j: int, least: float, thresholds: Thresholds
) -> ForceSignature | None:
    """The signature of no effect on joint j that explains most beside what was found, more than the
    `least`, chance and errors of the processing; None if there is none.
    """
    rest = _columns(found)
    known = explained(search, *rest)
    best, most = None, least
    joint = search.evidence.joints[j]
    sensing = suspected(found, joint)
    here = any(one.shaped.candidate.joint == joint for one in found)
    for other in search.shapes.unlisted_signatures(joint):
        if other.term.is_of_sensors() and not here:
            continue  # it would stand in for nothing
        lead = explained(search, *rest, other.columns) - known
        if lead <= max(most, chance_of(other.columns, thresholds)):
            continue
        if other.term.is_of_sensors() and not sensing:
            # Wrong lengths leave such a force as well, and friction along a narrow way.
            most_of_own = thresholds.method.lead_share * lead
            if not _accounts_for(search, found, joint, other, most_of_own):
                continue
        if strength_on(search, lead, j) < thresholds.gates.smallest_strength:
            continue
        if other.term.is_of_sensors() and is_of_lengths(search, rest, other.columns, thresholds):
            continue
        if helps(held_out_gains(search, rest, other.columns)[0], thresholds):
            best, most = other, lead
    return best


def _left_by_form(found: Sequence[Judged], joint: str, thresholds: Thresholds) -> float:
    """Gain that the forms of the effects on a joint may leave; 0 if none has a form."""
    method, candidates = thresholds.method, [(one.shaped, one.score) for one in found]
    left = [
        score * (method.reading_share if one.term.is_of_sensors() else method.elsewhere_share)
        for one, score in candidates
        if one.candidate.joint == joint and not one.candidate.effect.formless
    ]
    return max(left, default=0.0)


def _accounts_for(
    search: Search, found: Sequence[Judged], joint: str, other: ForceSignature, most: float
) -> bool:
    """Return whether effects were found on a joint that explain no more than the `most` beside a
    signature: it is why they were found. Scales need not be among them.
    """
    both = explained(search, *_columns(found), other.columns)
    here = [one for one in found if one.shaped.candidate.joint == joint]
    laws = [one for one in here if not one.shaped.candidate.effect.formless]
    for these in (here, laws):
        rest = [one for one in found if not any(one is each for each in these)]
        alone = explained(search, *_columns(rest), other.columns)
        if these and both - alone <= most:
            return True
    return False


def suspected(found: Sequence[Judged], joint: str) -> bool:
    """Return whether an effect of the sensors was found on a joint; not if the forces of two joints
    are scaled.
    """
    candidates = [one.shaped.candidate for one in found]
    lengths = sum(one.effect.formless for one in candidates) > 1
    return any(
        one.joint == joint and one.term.family == SENSING and not (lengths and one.effect.formless)
        for one in candidates
    )


def _instead(search: Search, found: Sequence[Judged], one: Judged, other: ForceSignature) -> bool:
    rest = _columns([each for each in found if each is not one])
    return explained(search, *rest, other.columns) > explained(search, *rest, one.shaped.columns)


def _columns(found: Sequence[Judged]) -> list[np.ndarray]:
    return [one.shaped.columns for one in found]
