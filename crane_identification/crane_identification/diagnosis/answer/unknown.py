"""What is known of an unknown force: its joint, what it may depend on, and in which recordings."""

from dataclasses import dataclass

import numpy as np

from crane_identification.diagnosis.decision.cross_validation import held_out_gains
from crane_identification.diagnosis.decision.shape import signatures
from crane_identification.diagnosis.search.energy import explained, unexplained
from crane_identification.diagnosis.search.search import Search
from crane_identification.diagnosis.search.selection import NOTHING

LISTED = 3  # signatures, the best ones
FAR = 2.0  # times the median of the recordings, from which one differs


@dataclass(frozen=True)
class NearSignature:
    """A signature in words, the `types` of the effects that have it, and the `share` of the energy
    beyond noise that any shape of it explains; on how many of the recordings `asked` it helps when
    it is fitted to the others.
    """

    said: str
    types: tuple[str, ...]
    share: float
    better: int
    asked: int


@dataclass(frozen=True)
class UnknownForce:
    """Of the joint that most of an unknown force is on: the nearest signatures, best first, and the
    recordings in which there is far more of it than in most, with the ratio.
    """

    joint: str
    signatures: tuple[NearSignature, ...]
    recordings: dict[str, float]


def unknown_force(search: Search) -> UnknownForce:
    """Of what the model leaves, before anything is added."""
    joints = search.evidence.joints
    beyond = np.maximum(unexplained(search, NOTHING), 0.0).reshape(-1, len(joints)).sum(axis=0)
    j = int(np.argmax(beyond))
    near = []
    for one in signatures(search, joints[j]):
        gains, _ = held_out_gains(
            search.evidence, search.whitener, search.evidence.free, one.columns
        )
        asked = gains[np.isfinite(gains)]
        share = explained(search, one.columns) / max(float(beyond[j]), 1.0)
        better = int((asked > 0.0).sum())
        near.append(NearSignature(one.said, one.types, min(share, 1.0), better, len(asked)))
    near.sort(key=lambda one: -one.share)
    return UnknownForce(joints[j], tuple(near[:LISTED]), _differing(search, j))


def _differing(search: Search, j: int) -> dict[str, float]:
    """Recordings with far more of what is left of a joint, rms over the median of all."""
    evidence, white = search.evidence, search.whitener
    own = white.channel % len(evidence.joints) == j
    bag = evidence.bag[white.row[own]]
    power = np.bincount(bag, search.base.residual[own] ** 2, len(evidence.sources))
    rms = np.sqrt(power / np.maximum(np.bincount(bag, minlength=len(evidence.sources)), 1))
    middle = max(float(np.median(rms)), np.finfo(float).tiny)
    pairs = zip(evidence.sources, (rms / middle).tolist(), strict=True)
    return {name: ratio for name, ratio in pairs if ratio > FAR}
