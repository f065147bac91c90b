"""How strong an effect is, and how strong it would have to be to show."""

import numpy as np

from crane_identification.diagnosis.candidates import Family
from crane_identification.diagnosis.evidence import Evidence
from crane_identification.diagnosis.gap import relative
from crane_identification.diagnosis.search import Search

DETECTABLE_SHARE = 0.9
"""Share of the effects that would show at the strength that is called detectable."""


def acting(evidence: Evidence, columns: np.ndarray, values: np.ndarray) -> float:
    """Root mean square of an effect, columns (n, c, k) with these values (k,), over that of the
    drive force of its joint: what the manual calls its strength.
    """
    return float(np.nan_to_num(relative(evidence, columns @ values)).max())


def strength(search: Search, number: int, score: float) -> float:
    """Root mean square of what an option of this score explains, over that of its joint's force.

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
    """Strength at which nearly all of the testable families would reach the threshold.

    Infinite where none is testable.
    """
    strengths: dict[Family, float] = {}
    options = search.projection.options
    for number, share in enumerate(search.projection.visibility):
        family = options[number].family
        least = strength(search, number, threshold) / max(float(share), 1e-9)
        strengths[family] = min(strengths.get(family, np.inf), least)
    return float(np.quantile(list(strengths.values()), DETECTABLE_SHARE)) if strengths else np.inf
