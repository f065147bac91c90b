"""How much candidates explain, and how much they leave, in energy beyond noise."""

from collections.abc import Sequence

import numpy as np

from crane_identification.diagnosis.fit.evidence import (
    VISIBLE_SHARE,
    Evidence,
    beside,
    leading,
    relative,
)
from crane_identification.diagnosis.search.candidates import Candidate, ShapedCandidate
from crane_identification.diagnosis.search.search import Search
from crane_identification.diagnosis.search.selection import NOTHING, Subset, solve

DETECTABLE_SHARE = 0.9
"""Share of the effects that would show at the strength that is called detectable."""


def channels(search: Search, number: int) -> np.ndarray:
    """The channels in which a candidate acts: of its joint, and of those that carry it too."""
    return np.flatnonzero(search.projection.candidates[number].columns.any(axis=(0, 2)))


def explained(search: Search, *columns: np.ndarray) -> float:
    """2 dlogL that columns (n, c, k), whatever their signs, gain together beside the base."""
    white = search.whitener(np.concatenate(columns, axis=2))
    rest = beside(search.base.basis, white)
    seen = np.linalg.norm(rest, axis=0) > VISIBLE_SHARE * np.linalg.norm(white, axis=0)
    known = leading(rest[:, seen], int(seen.sum()))
    return float(((known.T @ search.base.residual) ** 2).sum())


def unexplained(search: Search, subset: Subset) -> np.ndarray:
    """Energy (c,) beyond noise of variance one that a set leaves in each channel."""
    projection = search.projection
    inside = [column for i in subset.numbers for column in projection.columns_of[i]]
    left = projection.residual - projection.columns[:, inside] @ subset.values
    noise = 1.0 - (search.base.basis**2).sum(axis=1)
    return _by_channel(search, left**2 - noise)


def _by_channel(search: Search, power: np.ndarray) -> np.ndarray:
    """The sum (c,) of what whitened rows (N,) have in each channel."""
    return np.bincount(search.whitener.channel, power, search.evidence.used.shape[1])


def unexplained_beside(search: Search, subset: Subset, place: int) -> float:
    """What a set leaves unexplained where one of its effects acts; 0 where that is but noise."""
    left = unexplained(search, subset)[channels(search, subset.numbers[place])].sum()
    return max(float(left), 0.0)


def left_share(search: Search, wanted: Sequence[ShapedCandidate]) -> float:
    """Share of the energy beyond noise that these together leave where they act; 0 for none.

    Noise is an estimate, so that what is left may be a little less than nothing.
    """
    numbers = tuple(search.number(one) for one in wanted)
    subset = solve(search.projection, numbers) if numbers else None
    if subset is None:
        return 0.0
    own = sorted({int(channel) for number in numbers for channel in channels(search, number)})
    before, after = (unexplained(search, one)[own].sum() for one in (NOTHING, subset))
    return float(after / before) if before > 0.0 else 0.0


def energy_shares(search: Search, number: int) -> np.ndarray:
    """Share (c,) of what a candidate explains beside the base that each channel carries."""
    projection = search.projection
    power = (projection.columns[:, projection.columns_of[number]] ** 2).sum(axis=1)
    shares = _by_channel(search, power)
    return shares / max(float(shares.sum()), np.finfo(float).tiny)


def acting(evidence: Evidence, columns: np.ndarray, values: np.ndarray) -> float:
    """Root mean square of an effect, columns (n, c, k) with these values (k,), over that of the
    drive force of its joint: what the manual calls its strength.
    """
    return float(np.nan_to_num(relative(evidence, columns @ values)).max())


def strength(search: Search, number: int, score: float) -> float:
    """Root mean square of what a candidate of this score explains, over that of its joint's force.

    That is the part of the effect that shows beside the model.
    """
    return float(strengths(search, score * energy_shares(search, number)).max())


def strength_on(search: Search, gain: float, j: int) -> float:
    """Root mean square of what so much `gain` on joint j is, over that of its force."""
    energy = np.zeros(len(search.whitener.noise))
    energy[j] = gain
    return float(strengths(search, energy)[j])


def strengths(search: Search, energy: np.ndarray) -> np.ndarray:
    """Root mean square (j,) of what has so much energy (c,) on each joint, over that of its force;
    energy below zero, as noise may leave it, is none.
    """
    evidence, joints = search.evidence, len(search.evidence.joints)
    variance = np.array([0.0 if one is None else one.variance for one in search.whitener.noise])
    power = (np.maximum(energy, 0.0) * variance).reshape(-1, joints).sum(axis=0)
    rows = evidence.used.reshape(len(evidence.time), -1, joints).sum(axis=(0, 1))
    rms = np.sqrt(power / np.maximum(rows, 1))
    force = evidence.force_rms[:joints]
    return np.divide(rms, force, out=np.zeros_like(rms), where=force > 0.0)


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


def named_from(search: Search, threshold: float, gate: float) -> dict[str, float]:
    """By joint: the strength from which nearly all of the testable candidates there are named, of
    the effect itself, before it is filtered to rows; infinite where none is testable.

    Its score reaches the `threshold`, what shows of it the `gate`, its value what is usual. Of
    the shapes of a candidate the median counts: nobody knows that of the machine.
    """
    strengths: dict[Candidate, list[float]] = {}
    for number, shaped in enumerate(search.projection.candidates):
        least = _named_from(search, number, threshold, gate)
        strengths.setdefault(shaped.candidate, []).append(least)
    out = {}
    for joint in search.evidence.joints:
        own = [np.median(each) for one, each in strengths.items() if one.joint in (joint, None)]
        out[joint] = float(np.quantile(own, DETECTABLE_SHARE, method="higher")) if own else np.inf
    return out


def _named_from(search: Search, number: int, threshold: float, gate: float) -> float:
    """Strength of a candidate at its shape from which it is named, by its least visible column;
    infinite where one does not show.
    """
    projection = search.projection
    shaped, columns = projection.candidates[number], projection.columns_of[number]
    effect, scale = shaped.candidate.effect, projection.scale[columns]
    shows = strength(search, number, 1.0)  # with a score of one
    if shows <= 0.0 or not (scale > 0.0).all():
        return np.inf
    score = threshold if effect.formless else max(threshold, (gate / shows) ** 2)
    values = np.maximum(np.sqrt(score) / scale, effect.usual)
    acts = [
        acting(search.evidence, shaped.columns[:, :, [k]], values[[k]]) for k in range(len(values))
    ]
    return max(acts) / shaped.damped


def normalized_energy(search: Search, left: np.ndarray) -> np.ndarray:
    """Energy (c,) of a residual (n, c) in units of the noise."""
    variance = [1.0 if noise is None else noise.variance for noise in search.whitener.noise]
    return (np.where(search.evidence.used, left, 0.0) ** 2).sum(axis=0) / np.array(variance)


def testable_share(search: Search) -> float:
    """Share of the effects that would show beside the model, of those that are observable."""
    tested = {shaped.candidate for shaped in search.projection.candidates}
    return len(tested) / max(len(tested) + len(search.untestable), 1)
