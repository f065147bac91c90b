"""What is known of an unknown force: joint, size, what it may follow, and in which recordings."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from crane_identification.diagnosis.answer.differences import Difference, difference, differing
from crane_identification.diagnosis.answer.solved import solved
from crane_identification.diagnosis.decision.cross_validation import held_out_gains
from crane_identification.diagnosis.decision.judgement import Judged
from crane_identification.diagnosis.decision.shape import signatures
from crane_identification.diagnosis.fit.evidence import beside
from crane_identification.diagnosis.search.energy import (
    explained,
    strength_on,
    strengths,
    unexplained,
)
from crane_identification.diagnosis.search.lengths import widened
from crane_identification.diagnosis.search.search import Search
from crane_identification.diagnosis.search.selection import NOTHING
from crane_identification.diagnosis.search.shapes import ForceSignature
from crane_identification.thresholds import Thresholds
from crane_model.terms import DrawnCurve

LISTED = 3  # signatures, the best ones


class Drawing(NamedTuple):
    """A dependence as it was drawn, its standard deviations drawn alike, and its unit."""

    curve: DrawnCurve
    std_devs: DrawnCurve
    unit: str


@dataclass(frozen=True)
class NearSignature:
    """A signature in words, the `types` of the effects that have it, and the `share` of the energy
    beyond noise that any shape of it explains; on how many of the recordings `asked` it helps when
    it is fitted to the others; and the best shape, `drawn` for each of its factors.
    """

    said: str
    types: tuple[str, ...]
    share: float
    better: int
    asked: int
    drawn: tuple[Drawing, ...]


@dataclass(frozen=True)
class UnknownForce:
    """On the joint whose force errs most: its `strength`, rms over that of the drive; the nearest
    signatures, best first; the recordings in which there is far more of it than in most, with the
    ratio; and what of the model is not alike in all recordings, where that is most of it.
    """

    joint: str
    strength: float
    signatures: tuple[NearSignature, ...]
    recordings: dict[str, float]
    difference: Difference | None


def unknown_force(search: Search, j: int) -> UnknownForce:
    """Of what the model leaves on joint number j, before anything is added."""
    return _on(search, j)


def left_elsewhere(
    search: Search, effects: Sequence[Judged], threshold: float, thresholds: Thresholds
) -> tuple[UnknownForce, ...]:
    """Of what `effects` leave on each joint where none of them acts, largest first.

    Of its signatures one explains more than chance gives to the best of the catalogue, `threshold`,
    and than the errors of the processing.
    """
    joints = search.evidence.joints
    acted = {j for one in effects for j in one.shaped.joints(joints)}
    elsewhere = [j for j in range(len(joints)) if j not in acted]
    if not elsewhere:
        return ()
    left = widened(search, np.concatenate([one.shaped.columns for one in effects], axis=2))
    beyond = _beyond_noise(left)
    found = []
    for j in elsewhere:
        gains = [explained(left, one.columns) for one in signatures(left, joints[j])]
        most = min(max(gains, default=0.0), float(beyond[j]))
        strong = strength_on(left, most, j) >= thresholds.gates.smallest_strength
        if most > threshold and strong:
            found.append(_on(left, j))
    return tuple(sorted(found, key=lambda one: -one.strength))


def _beyond_noise(search: Search) -> np.ndarray:
    """What the model leaves on each joint (j,), in energy."""
    by_channel = np.maximum(unexplained(search, NOTHING), 0.0)
    return by_channel.reshape(-1, len(search.evidence.joints)).sum(axis=0)


def _on(search: Search, j: int) -> UnknownForce:
    """What is known of what the model leaves on joint number j."""
    joint, beyond = search.evidence.joints[j], float(_beyond_noise(search)[j])
    near = [_near(search, one, beyond) for one in signatures(search, joint)]
    near.sort(key=lambda one: -one.share)
    return UnknownForce(
        joint,
        float(strengths(search, unexplained(search, NOTHING))[j]),
        tuple(near[:LISTED]),
        differing(search, j),
        difference(search, j, beyond),
    )


def _near(search: Search, one: ForceSignature, beyond: float) -> NearSignature:
    evidence = search.evidence
    gains, _ = held_out_gains(evidence, search.whitener, evidence.free, one.columns)
    asked = gains[np.isfinite(gains)]
    share = explained(search, one.columns) / max(beyond, 1.0)
    better = int((asked > 0.0).sum())
    drawn = _drawn(search, one)
    return NearSignature(one.said, one.types, min(share, 1.0), better, len(asked), drawn)


def _drawn(search: Search, one: ForceSignature) -> tuple[Drawing, ...]:
    """The best shape of a signature, beside the model; nothing where it is no curve."""
    best = solved(search, beside(search.base.basis, search.whitener(one.columns)))
    parameters = one.term.parameters(search.evidence.model.setting)
    pairs = zip(one.term.curves(best.values), one.term.curves(best.std_devs), strict=True)
    return tuple(Drawing(*pair, parameters[k].unit) for k, pair in enumerate(pairs))
