"""Forces of no effect of the catalogue, beside the effects that were found or in their place.

What a law leaves because it is not quite the machine's follows no signature well. So a signature
of no effect is there if it is most of what is left on a joint, as much beside the laws there as is
asked of an effect, and predicts it elsewhere.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from crane_identification.diagnosis.decision.cross_validation import held_out_gains, helps
from crane_identification.diagnosis.decision.judgement import Judged
from crane_identification.diagnosis.decision.of_lengths import is_of_lengths
from crane_identification.diagnosis.decision.rising import falls
from crane_identification.diagnosis.decision.shape import chance_of
from crane_identification.diagnosis.search.energy import explained, strength_on, unexplained
from crane_identification.diagnosis.search.lengths import beside_lengths
from crane_identification.diagnosis.search.search import Search
from crane_identification.diagnosis.search.selection import NOTHING, solve
from crane_identification.diagnosis.search.shapes import ForceSignature
from crane_identification.thresholds import Thresholds

SENSING = "sensing"  # family of terms


class Strange(NamedTuple):
    """Of effects that were found, those that are `kept` beside what no effect is, `said` in words.

    Nothing is said where there is no such force.
    """

    kept: tuple[Judged, ...]
    said: tuple[str, ...]


def with_strange(
    search: Search, found: Sequence[Judged], threshold: float, thresholds: Thresholds
) -> Strange:
    """What was found, without effects in whose place a signature of no effect explains more.

    `threshold` is what chance gives to the best effect of the catalogue.
    """
    found, said = _without_falling(search, found, thresholds)
    kept = list(found)
    numbers = tuple(search.number(one.shaped) for one in found)
    subset = (solve(search.projection, numbers) if numbers else None) or NOTHING
    joints = search.evidence.joints
    left = np.maximum(unexplained(search, subset), 0.0).reshape(-1, len(joints)).sum(axis=0)
    for j, joint in enumerate(joints):
        least = max(
            threshold,
            thresholds.method.simple_share * float(left[j]),
            _left_by_form(found, joint, thresholds),
        )
        other = _most_of(search, found, j, least, thresholds)
        if other is not None:
            said.append(f"on {joint} there is {other.said}, as of no effect of the catalogue")
            kept = [
                one
                for one in kept
                if one.shaped.candidate.joint != joint or not _instead(search, found, one, other)
            ]
    return Strange(tuple(kept), tuple(said))


def _without_falling(
    search: Search, found: Sequence[Judged], thresholds: Thresholds
) -> tuple[list[Judged], list[str]]:
    """The effects without those of a shape that falls where their laws rise, and these in words."""
    kept, said = [], []
    for one in found:
        candidate = one.shaped.candidate
        rest = _columns([other for other in found if other is not one])
        if candidate.drawn and falls(search, one.shaped, rest, thresholds):
            force = f"on {candidate.joint} there is {candidate.effect.signature}, and falls"
            said.append(f"{force}, as of no effect of the catalogue")
        else:
            kept.append(one)
    return kept, said


def _most_of(
    search: Search, found: Sequence[Judged], j: int, least: float, thresholds: Thresholds
) -> ForceSignature | None:
    """The signature of no effect on joint j that explains most beside what was found, more than
    the `least`, and more than chance and the errors of the processing do; None if there is none.
    """
    rest = _columns(found)
    known = explained(search, *rest) if rest else 0.0
    best, most = None, least
    joint = search.evidence.joints[j]
    sensing = suspected(found, joint)
    here = any(one.shaped.candidate.joint == joint for one in found)
    for other in search.shapes.strangers(joint):
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
        before = np.concatenate([search.evidence.free, *rest], axis=2)
        gains, _ = held_out_gains(search.evidence, search.whitener, before, other.columns)
        of_sensors = other.term.is_of_sensors()  # lengths leave such a force
        if of_sensors and is_of_lengths(
            search, beside_lengths(search), rest, other.columns, thresholds
        ):
            continue
        if helps(gains, thresholds):
            best, most = other, lead
    return best


def _left_by_form(found: Sequence[Judged], joint: str, thresholds: Thresholds) -> float:
    """What the laws on a joint may leave because their forms are not the machine's; 0 if none."""
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
    """Whether effects were found on a joint that explain no more than the `most` beside a
    signature: it is why they were found. Scales, which wrong lengths make as well, need not be
    among them.
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
    """Whether what was found on a joint is of its sensors: not where the forces of two joints are
    scaled, which is lengths that are off.
    """
    candidates = [one.shaped.candidate for one in found]
    lengths = sum(one.effect.formless for one in candidates) > 1
    return any(
        one.joint == joint and one.term.family == SENSING and not (lengths and one.effect.formless)
        for one in candidates
    )


def _instead(search: Search, found: Sequence[Judged], one: Judged, other: ForceSignature) -> bool:
    """Whether a signature explains more in the place of an effect than that does."""
    rest = _columns([each for each in found if each is not one])
    return explained(search, *rest, other.columns) > explained(search, *rest, one.shaped.columns)


def _columns(found: Sequence[Judged]) -> list[np.ndarray]:
    return [one.shaped.columns for one in found]
