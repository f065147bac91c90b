"""Forces that resemble an effect of the catalogue and are not one."""

from collections.abc import Collection, Sequence

import numpy as np

from crane_identification.diagnosis.judgement import (
    Beyond,
    Judged,
    chance_of,
    held_out_gains,
    marginal,
    predicts,
    without,
)
from crane_identification.diagnosis.projection import Subset
from crane_identification.diagnosis.search import ForceSignature, Search
from crane_identification.diagnosis.several import factors

# Whether a further effect is but the form of another one.
#
# A law that is not quite the machine's leaves a share of its own force, which a further effect may
# resemble. If the curve of the stronger one explains no more than its law, in training and of
# recordings that it was not fitted to, the law is the machine's, and leaves nothing.


def of_one_form(search: Search, subset: Subset, chance: float, settled: int = 0) -> bool:
    """Return whether an effect after the `settled` is only a rest that a form leaves."""
    found = [search.projection.candidates[number].candidate for number in subset.numbers]
    if all(one.changes for one in found):
        return False
    gains = marginal(search, subset)
    formless = {place for place, one in enumerate(found) if one.effect.formless}
    where = [search.channels(number) for number in subset.numbers]
    share = search.thresholds.method.further_share
    return any(
        slight(where, gains, share, place, formless)
        and not fills(search, subset, place, chance)
        and not stands_apart(search, subset, gains, place, chance)
        for place in range(settled, len(gains))
    )


def slight(
    channels: Sequence[np.ndarray],
    gains: Sequence[float],
    share: float,
    place: int,
    formless: Collection[int] = (),
) -> bool:
    """Return whether an effect gains as little as the form of another one may leave."""
    own = set(channels[place].tolist())
    return any(
        gains[place] < share * gains[k] and own & set(channels[k].tolist())
        for k in range(len(channels))
        if k not in formless
    )


def fills(search: Search, subset: Subset, place: int, chance: float) -> bool:
    """Return whether an effect explains most of what is left where it acts, beyond `chance`."""
    own = search.channels(subset.numbers[place])
    before, after = (
        float(search.unexplained(one)[own].sum())
        for one in (without(search, subset, place), subset)
    )
    least = search.thresholds.method.simple_share
    return before > chance and after <= (1.0 - least) * before


def stands_apart(
    search: Search, subset: Subset, gains: Sequence[float], place: int, chance: float
) -> bool:
    """Return whether one effect of a set explains beside any curve of the stronger ones what it
    does beside their model forms, more than `chance` and of recordings that it was not fitted to;
    and each of these forms leaves nothing to its curve.
    """
    found = [search.projection.candidates[number] for number in subset.numbers]
    own, known = found[place], [one.columns for k, one in enumerate(found) if k != place]
    every = [one.columns for one in found]
    for law, gain in zip(found, gains, strict=True):
        if law is own or gain <= gains[place] or law.candidate.effect.formless:
            continue
        curve = search.shapes.of(law.candidate)
        if curve is None:
            return False
        known.append(curve.columns)
        if law.candidate.drawn:
            continue
        limit = chance_of(search, curve.columns)
        if search.gained(every, curve.columns) > limit:
            return False
        if np.nansum(held_out_gains(search, every, curve.columns)[0]) > limit:
            return False
    least = max(chance, search.thresholds.method.simple_share * gains[place])
    return search.gained(known, own.columns) > least and predicts(search, known, own.columns)


# Forces of no effect of the catalogue, added to the effects that were found, or replacing them.
#
# What a law leaves because it is not quite the machine's follows no signature well. So a signature
# of no effect is there if it is most of what is left on a joint, adds as much to the laws there as
# an effect must, and predicts other recordings.

SENSING = "sensing"  # family of terms


def with_strange(
    search: Search, found: Sequence[Judged], threshold: float
) -> tuple[tuple[Judged, ...], tuple[Beyond, ...]]:
    """The effects that no unlisted signature replaces, and these signatures."""
    kept, beyond, method = list(found), [], search.thresholds.method
    left = search.unexplained_on_joints(search.together(one.shaped for one in found))
    for j, joint in enumerate(search.evidence.joints):
        forms = [  # gains that the forms of the effects on the joint may leave
            one.score
            * (method.reading_share if one.shaped.term.is_of_sensors() else method.elsewhere_share)
            for one in found
            if one.shaped.candidate.joint == joint and not one.shaped.candidate.effect.formless
        ]
        least = max(threshold, method.simple_share * float(left[j]), *forms)
        other = _most_of(search, found, j, least)
        if other is not None:
            beyond.append(Beyond(joint, other.said))
            kept = [
                one
                for one in kept
                if one.shaped.candidate.joint != joint or not _instead(search, found, one, other)
            ]
    return tuple(kept), tuple(beyond)


def _most_of(
    search: Search, found: Sequence[Judged], j: int, least: float
) -> ForceSignature | None:
    """The unlisted signature on joint j that explains most, more than the `least` and chance."""
    rest, joint = _columns(found), search.evidence.joints[j]
    best, most = None, least
    here = any(one.shaped.candidate.joint == joint for one in found)
    for other in search.shapes.unlisted_signatures(joint):
        of_sensors = other.term.is_of_sensors()
        if of_sensors and not here:
            continue  # it would stand in for nothing
        lead = search.gained(rest, other.columns)
        if lead <= max(most, chance_of(search, other.columns)) or not search.is_strong(lead, j):
            continue
        if of_sensors:  # wrong lengths leave such a force as well, and friction along a narrow way
            own = search.thresholds.method.lead_share * lead
            stands_in = suspected(found, joint) or _accounts_for(search, found, joint, other, own)
            if not stands_in or is_of_lengths(search, rest, other.columns):
                continue
        if predicts(search, rest, other.columns):
            best, most = other, lead
    return best


def is_of_lengths(search: Search, rest: Sequence[np.ndarray], columns: np.ndarray) -> bool:
    """Return whether columns (n, c, k), beside the `rest`, gain less than half as much beside
    lengths that are off and scales of all joints' forces: wrong lengths leave a little everywhere.
    """
    longer = search.beside_lengths()
    scales = [longer.projection.candidates[number].columns for number in factors(longer)]
    least = search.thresholds.method.simple_share * search.gained(rest, columns)
    return longer.gained([*rest, *scales], columns) < least


def _accounts_for(
    search: Search, found: Sequence[Judged], joint: str, other: ForceSignature, most: float
) -> bool:
    """Return whether a signature leaves at most the `most` to the effects of a joint."""
    both = search.explained(*_columns(found), other.columns)
    here = [one for one in found if one.shaped.candidate.joint == joint]
    laws = [one for one in here if not one.shaped.candidate.effect.formless]
    for these in (here, laws):
        rest = [one for one in found if not any(one is each for each in these)]
        if these and both - search.explained(*_columns(rest), other.columns) <= most:
            return True
    return False


def suspected(found: Sequence[Judged], joint: str) -> bool:
    """Return whether a joint has an effect of sensors, unless two joints are scaled."""
    candidates = [one.shaped.candidate for one in found]
    lengths = sum(one.effect.formless for one in candidates) > 1
    return any(
        one.joint == joint and one.term.family == SENSING and not (lengths and one.effect.formless)
        for one in candidates
    )


def _instead(search: Search, found: Sequence[Judged], one: Judged, other: ForceSignature) -> bool:
    rest = _columns([each for each in found if each is not one])
    reached = search.explained(*rest, other.columns)
    return reached > search.explained(*rest, one.shaped.columns)


def _columns(found: Sequence[Judged]) -> list[np.ndarray]:
    return [one.shaped.columns for one in found]
