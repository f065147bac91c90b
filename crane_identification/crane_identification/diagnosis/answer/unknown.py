"""What is known of an unknown force: joint, size, what it may follow, and in which recordings."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from crane_identification.diagnosis.answer.differences import Difference, difference, differing
from crane_identification.diagnosis.decision.cross_validation import held_out_gains
from crane_identification.diagnosis.decision.shape import signatures
from crane_identification.diagnosis.fit.evidence import beside, normed
from crane_identification.diagnosis.search.energy import explained, unexplained
from crane_identification.diagnosis.search.search import Search
from crane_identification.diagnosis.search.selection import NOTHING
from crane_identification.diagnosis.search.shapes import ForceSignature
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
    """Of the joint that most of an unknown force is on: its `strength`, rms over that of the drive;
    the nearest signatures, best first; the recordings in which there is far more of it than in
    most, with the ratio; and what of the model is not alike in all recordings, where that is most
    of it.
    """

    joint: str
    strength: float
    signatures: tuple[NearSignature, ...]
    recordings: dict[str, float]
    difference: Difference | None


def unknown_force(search: Search) -> UnknownForce:
    """Of what the model leaves, before anything is added."""
    joints = search.evidence.joints
    by_channel = np.maximum(unexplained(search, NOTHING), 0.0)
    beyond = by_channel.reshape(-1, len(joints)).sum(axis=0)
    j = int(np.argmax(beyond))
    near = [_near(search, one, float(beyond[j])) for one in signatures(search, joints[j])]
    near.sort(key=lambda one: -one.share)
    return UnknownForce(
        joints[j],
        _strength(search, by_channel, j),
        tuple(near[:LISTED]),
        differing(search, j),
        difference(search, j, float(beyond[j])),
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
    columns, norms = normed(beside(search.base.basis, search.whitener(one.columns)))
    spread = np.linalg.pinv(columns.T @ columns, rcond=1e-10, hermitian=True)
    values = spread @ (columns.T @ search.base.residual) / norms
    std_devs = np.sqrt(np.diag(spread)) / norms
    parameters = one.term.parameters(search.evidence.model.setting)
    pairs = zip(one.term.curves(values), one.term.curves(std_devs), strict=True)
    return tuple(Drawing(*pair, parameters[k].unit) for k, pair in enumerate(pairs))


def _strength(search: Search, by_channel: np.ndarray, j: int) -> float:
    """Rms of what is beyond noise on a joint, over that of its force."""
    evidence, joints = search.evidence, len(search.evidence.joints)
    variance = np.array([0.0 if one is None else one.variance for one in search.whitener.noise])
    power = float((by_channel * variance)[j::joints].sum())
    rows = int(evidence.used[:, j::joints].sum())
    force = evidence.force_rms[j]
    return float(np.sqrt(power / max(rows, 1)) / force) if force > 0.0 else 0.0
