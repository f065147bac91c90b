"""What an effect is weighed by: its strength, and others in its place."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from crane_identification.diagnosis.candidates import Candidate, ShapedCandidate
from crane_identification.diagnosis.evidence import Evidence
from crane_identification.diagnosis.gap import relative
from crane_identification.diagnosis.projection import Projection
from crane_identification.diagnosis.search import Search
from crane_identification.diagnosis.selection import (
    NOTHING,
    Subset,
    constrained,
    extended,
    others,
    solve,
)
from crane_identification.diagnosis.thresholds import Thresholds

DETECTABLE_SHARE = 0.9
"""Share of the effects that would show at the strength that is called detectable."""


def without(search: Search, subset: Subset, place: int) -> Subset:
    """The set without one of its effects."""
    rest = others(subset, place)
    return (solve(search.projection, rest) or NOTHING) if rest else NOTHING


def in_place_of(search: Search, subset: Subset, place: int) -> list[Subset]:
    """The set with each other candidate in the place of one of its effects, best first."""
    projection = search.projection
    candidate = projection.candidates[subset.numbers[place]].candidate
    replaced = extended(projection, without(search, subset, place))
    ranked = sorted(replaced, key=lambda one: -one.gain)
    return [one for one in ranked if projection.candidates[one.numbers[-1]].candidate != candidate]


def freedom(search: Search, number: int) -> int:
    """Number of parameters of a candidate, shapes included, and one for what the model lacks."""
    shaped = search.projection.candidates[number]
    return len(shaped.positive) + len(shaped.candidate.shapes) + (not shaped.candidate.changes)


def same_effect(one: Candidate, other: Candidate) -> bool:
    """Whether both are laws of the same effect, on the same joint."""
    return one.joint == other.joint and other.type in one.effect.kin


def likeness(search: Search, one: int, other: int) -> float:
    """Cosine of the angle by which what one candidate explains lies outside the other, beside the
    base: of the one with fewer columns the worst of them, as far as the signs of parameters let the
    other one follow it.
    """
    projection = search.projection
    a, b = projection.columns_of[one], projection.columns_of[other]
    gram, free = projection.gram, ~projection.positive
    if len(a) > 1 and len(b) > 1 and free[a].all() and free[b].all():
        roots = [np.linalg.cholesky(gram[np.ix_(c, c)] + 1e-12 * np.eye(len(c))) for c in (a, b)]
        mixed = np.linalg.solve(roots[0], np.linalg.solve(roots[1], gram[np.ix_(b, a)]).T)
        return float(np.linalg.svd(mixed, compute_uv=False).min())
    pairs = [(few, many) for few, many in ((a, b), (b, a)) if len(few) <= len(many)]
    return min(
        max(_followed(projection, sign, column, many) for sign in _signs(free[column]))
        for few, many in pairs
        for column in few
    )


def _signs(free: bool) -> tuple[float, ...]:
    """Signs that a parameter may have."""
    return (1.0, -1.0) if free else (1.0,)


def _followed(projection: Projection, sign: float, column: int, others: np.ndarray) -> float:
    """Cosine between a column of that sign and the nearest force that others can have."""
    inner = sign * projection.gram[others, column]
    block = projection.gram[np.ix_(others, others)]
    values = constrained(block, inner, projection.positive[others])
    return 0.0 if values is None else float(np.sqrt(max(values @ inner, 0.0)))


def same_as(
    search: Search,
    swaps: Sequence[Subset],
    indistinct: Sequence[Candidate],
    needed: float,
    alike: float,
) -> list[Candidate]:
    """Further candidates that are no worse than one of the class, and whose columns are `alike` to
    its own: they belong to the class as well.
    """
    candidates = search.projection.candidates
    known = [one for one in swaps if candidates[one.numbers[-1]].candidate in indistinct]
    return [
        candidates[one.numbers[-1]].candidate
        for one in swaps
        if one not in known
        and any(
            own.gain - one.gain <= needed
            and likeness(search, one.numbers[-1], own.numbers[-1]) > alike
            for own in known
        )
    ]


def slight(channels: Sequence[np.ndarray], gains: Sequence[float], thresholds: Thresholds) -> bool:
    """Whether one of several effects gains too little beside another to be told from its form.

    `channels` are those where each acts. What a law leaves because it is not quite that of the
    machine is on its own joint, most of it.
    """
    where, method = [set(one.tolist()) for one in channels], thresholds.method
    for own, gain in zip(where, gains, strict=True):
        there = max(g for other, g in zip(where, gains, strict=True) if own & other)
        least = max(method.further_share * there, method.elsewhere_share * max(gains))
        if gain < least:
            return True
    return False


def mends(
    search: Search, numbers: Sequence[int], gains: Sequence[float], thresholds: Thresholds
) -> bool:
    """Whether one of several laws that resist the motion gains too little beside another of these
    on its joint to be more than what that one's form leaves.
    """
    candidates = search.projection.candidates
    resisting: dict[str, list[float]] = {}
    for number, gain in zip(numbers, gains, strict=True):
        joint = candidates[number].candidate.joint
        if joint is not None and reverses(search, candidates[number]):
            resisting.setdefault(joint, []).append(gain)
    return any(min(one) < thresholds.method.form_share * max(one) for one in resisting.values())


def reverses(search: Search, shaped: ShapedCandidate) -> bool:
    """Whether the force of a candidate changes its sign with the velocity, and nothing else."""
    setting = search.evidence.model.setting
    for run in search.evidence.runs:
        record = replace(run.record, direction_known=None)
        there = shaped.term.columns(record, setting)
        back = shaped.term.columns(replace(record, velocity=-record.velocity), setting)
        if there.any():
            return bool(np.allclose(back, -there))
    return False


def acting(evidence: Evidence, columns: np.ndarray, values: np.ndarray) -> float:
    """Root mean square of an effect, columns (n, c, k) with these values (k,), over that of the
    drive force of its joint: what the manual calls its strength.
    """
    return float(np.nan_to_num(relative(evidence, columns @ values)).max())


def strength(search: Search, number: int, score: float) -> float:
    """Root mean square of what a candidate of this score explains, over that of its joint's force.

    That is the part of the effect that shows beside the model.
    """
    shares = search.energy_shares(number)
    evidence = search.evidence
    joints = len(evidence.joints)
    variance = np.array([0.0 if one is None else one.variance for one in search.whitener.noise])
    power = (score * shares * variance).reshape(-1, joints).sum(axis=0)
    rows = evidence.used.reshape(len(evidence.time), -1, joints).sum(axis=(0, 1))
    rms = np.sqrt(power / np.maximum(rows, 1))
    force = evidence.force_rms[:joints]
    return float(np.max(np.divide(rms, force, out=np.zeros_like(rms), where=force > 0.0)))


def detectable(search: Search, threshold: float) -> float:
    """Strength at which nearly all of the testable candidates would reach the threshold.

    Infinite where none is testable.
    """
    strengths: dict[Candidate, float] = {}
    candidates = search.projection.candidates
    for number, share in enumerate(search.projection.visibility):
        candidate = candidates[number].candidate
        least = strength(search, number, threshold) / max(float(share), 1e-9)
        strengths[candidate] = min(strengths.get(candidate, np.inf), least)
    return float(np.quantile(list(strengths.values()), DETECTABLE_SHARE)) if strengths else np.inf
