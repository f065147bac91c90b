"""Which law of one signature an effect follows, told by where its shape bends and whether it falls.

Friction that falls with the speed and a loss that rises beyond it are both bent upwards. Beside
Coulomb and viscous friction, a law of the one that is not quite the machine's may fit the other.
"""

from collections.abc import Sequence

import numpy as np

from crane_identification.diagnosis.fit.evidence import normed
from crane_identification.diagnosis.search.candidates import Candidate, ShapedCandidate
from crane_identification.diagnosis.search.energy import explained
from crane_identification.diagnosis.search.search import Search
from crane_identification.diagnosis.search.shapes import shape_of

FALL_SHARE = 0.05  # of the height of a shape, by which friction falls at least where it does


def likelier(search: Search, law: Candidate, rest: Sequence[np.ndarray]) -> tuple[str, ...]:
    """Types of the laws at whose bends a shape explains more than at those of `law`, beside the
    `rest` (n, c, k each), and which fall where friction does, best first; none where the shape does
    not tell.
    """
    cls, shaped = shape_of(law), search.shapes.of(law)
    if cls is None or shaped is None or law.type not in cls.bends:
        return ()
    fallen = _fallen(search, shaped, rest, cls.slope_of)
    if fallen is None:
        return ()
    known = explained(search, *rest) if rest else 0.0
    gains = {
        kind: explained(search, *rest, shaped.columns[:, :, cls.at_bend(kind)]) - known
        for kind in cls.bends
        if kind == law.type or (kind in cls.falling) == (fallen > FALL_SHARE)
    }
    better = [kind for kind, gain in gains.items() if gain > gains[law.type]]
    return tuple(sorted(better, key=lambda kind: -gains[kind]))


def _fallen(
    search: Search, shaped: ShapedCandidate, rest: Sequence[np.ndarray], slope_of: str | None
) -> float | None:
    """By how much a shape over the speed falls together with the term of the type that holds its
    slope, over the height of the shape; None where the model has no such term to be fitted.
    """
    evidence, joint = search.evidence, shaped.candidate.joint
    sloped = [
        one for one in evidence.model.terms if one.type == slope_of and one.only_joint == joint
    ]
    if evidence.keeps or not sloped:
        return None
    columns = np.concatenate([evidence.free, *rest, shaped.columns], axis=2)
    scaled, norms = normed(search.whitener(columns))
    force = search.whitener(evidence.force)
    values = np.linalg.lstsq(scaled, force, rcond=1e-10)[0] / norms
    (curve,) = shaped.term.curves(values[-shaped.columns.shape[2] :])
    slope = values[evidence.model.part(sloped[0])][0]
    friction = curve.values + slope * np.array(curve.knots)
    fall = (np.maximum.accumulate(friction) - friction).max()
    return float(fall / max(np.ptp(curve.values), np.finfo(float).tiny))
