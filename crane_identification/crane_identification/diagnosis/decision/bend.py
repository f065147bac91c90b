"""Which law of one signature an effect follows, told by where its shape bends and whether it falls.

Friction that falls with the speed and a loss that rises beyond it are both bent upwards. Beside
Coulomb and viscous friction, a law of the one that is not quite the machine's may fit the other.
But no Coulomb friction is below zero, which a law that falls would leave where a strong loss bends.
"""

from collections.abc import Sequence
from typing import NamedTuple

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
    not tell. Those of a `law` that leaves no Coulomb friction need not explain more.
    """
    cls, shaped = shape_of(law), search.shapes.of(law)
    if cls is None or shaped is None or law.type not in cls.bends:
        return ()
    straight = max(cls.bends[law.type])  # from here on it follows the speed alone
    friction = _friction(search, shaped, rest, (cls.slope_of, cls.height_of), straight)
    if friction is None:
        return ()
    falls = friction.fallen > FALL_SHARE
    known = explained(search, *rest) if rest else 0.0
    gains = {
        kind: explained(search, *rest, shaped.columns[:, :, cls.at_bend(kind)]) - known
        for kind in cls.bends
        if kind == law.type or (kind in cls.falling) == falls
    }
    own = gains.pop(law.type)
    least = -np.inf if law.type in cls.falling and friction.left < 0.0 else own
    better = [kind for kind, gain in gains.items() if gain > least]
    return tuple(sorted(better, key=lambda kind: -gains[kind]))


class _Friction(NamedTuple):
    """By how much friction has `fallen` with the speed at most, over the height of its shape, and
    what is `left` of it at rest by the straight line that ends it.
    """

    fallen: float
    left: float


def _friction(
    search: Search,
    shaped: ShapedCandidate,
    rest: Sequence[np.ndarray],
    held: tuple[str | None, str | None],
    straight: int,
) -> _Friction | None:
    """A shape over the speed together with the terms of the types that hold its slope and its
    height, taken as straight beyond one of its knots; None where the model has no such terms to be
    fitted.
    """
    evidence, joint = search.evidence, shaped.candidate.joint
    terms = {one.type: one for one in evidence.model.terms if one.only_joint == joint}
    own = [terms[kind] for kind in held if kind in terms]
    if evidence.keeps or len(own) < len(held):
        return None
    columns = np.concatenate([evidence.free, *rest, shaped.columns], axis=2)
    scaled, norms = normed(search.whitener(columns))
    force = search.whitener(evidence.force)
    values = np.linalg.lstsq(scaled, force, rcond=1e-10)[0] / norms
    (curve,) = shaped.term.curves(values[-shaped.columns.shape[2] :])
    slope, height = (values[evidence.model.part(one)][0] for one in own)
    speed = np.array(curve.knots)
    friction = height + slope * speed + curve.values
    fall = (np.maximum.accumulate(friction) - friction).max()
    line = np.polyfit(speed[[straight, -1]], friction[[straight, -1]], 1)
    return _Friction(float(fall / max(np.ptp(curve.values), np.finfo(float).tiny)), float(line[-1]))
