"""Which law of one signature an effect follows, told by how its shape bends and whether it falls.

Friction that falls with the speed and a loss that rises beyond it are both bent upwards. Beside
Coulomb and viscous friction, a law of the one that is not quite the machine's may fit the other. So
families of curves are compared, not laws: the shape follows one of the right family closely. But
friction that has fallen is still there, of which a law that falls leaves nothing, or less, where a
strong loss bends.
"""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from crane_identification.diagnosis.fit.evidence import beside, leading, normed
from crane_identification.diagnosis.search.candidates import Candidate, ShapedCandidate
from crane_identification.diagnosis.search.search import Search
from crane_identification.diagnosis.search.shapes import shape_of
from crane_model.terms.drawn_friction import DrawnTerm

FALL_SHARE = 0.05  # of the height of a shape, by which friction falls at least where it does
LEAD_SHARE = 0.003  # of what the own family explains, that another one explains more at least
KINETIC_SHARE = 0.1  # of friction at rest, that is left of it at least where friction has fallen


def likelier(search: Search, law: Candidate, rest: Sequence[np.ndarray]) -> tuple[str, ...]:
    """Types of the laws a curve of whose family explains clearly more than any of that of `law`,
    beside the `rest` (n, c, k each), and which fall where friction does, best first; none where the
    shape does not tell. Those of a falling `law` that leaves no friction need not explain more.
    """
    cls, shaped = shape_of(law), search.shapes.of(law)
    if cls is None or shaped is None or law.type not in cls.families:
        return ()
    friction = _friction(search, shaped, rest, cls)
    if friction is None:
        return ()
    gone = friction.left < KINETIC_SHARE * max(friction.at_rest, 0.0)
    falls = friction.fallen > FALL_SHARE and not gone
    kinds = [kind for kind in cls.families if kind == law.type or (kind in cls.falling) == falls]
    gains = _gains(
        search, rest, shaped, {kind: cls.family_of(kind, friction.speeds) for kind in kinds}
    )
    own = (1.0 + LEAD_SHARE) * gains.pop(law.type)
    least = -np.inf if law.type in cls.falling and gone else own
    better = [kind for kind, gain in gains.items() if gain > least]
    return tuple(sorted(better, key=lambda kind: -gains[kind]))


def _gains(
    search: Search,
    rest: Sequence[np.ndarray],
    shaped: ShapedCandidate,
    families: Mapping[str, np.ndarray],
) -> dict[str, float]:
    """2 dlogL of the best curve of each family (k, m), which are of more friction, not of less."""
    base, white = search.base, search.whitener
    own = beside(base.basis, white(shaped.columns))
    if rest:
        others = beside(base.basis, white(np.concatenate(rest, axis=2)))
        own = beside(leading(others, others.shape[1]), own)
    gram, score = own.T @ own, own.T @ base.residual
    gains = {}
    for kind, curves in families.items():
        power = np.maximum(np.einsum("km,kl,lm->m", curves, gram, curves), np.finfo(float).tiny)
        gains[kind] = float((np.maximum(curves.T @ score, 0.0) ** 2 / power).max())
    return gains


class _Friction(NamedTuple):
    """By how much friction has `fallen` with the speed at most, over the height of its shape, what
    it is `at_rest`, and what is `left` of that by the straight line that ends it; and the `speeds`
    (knots,) of the shape.
    """

    speeds: np.ndarray
    fallen: float
    at_rest: float
    left: float


def _friction(
    search: Search,
    shaped: ShapedCandidate,
    rest: Sequence[np.ndarray],
    cls: type[DrawnTerm],
) -> _Friction | None:
    """A shape over the speed together with the terms that hold its slope and its height; None where
    the model has no such terms to be fitted.
    """
    evidence, joint = search.evidence, shaped.candidate.joint
    terms = {one.type: one for one in evidence.model.terms if one.only_joint == joint}
    own = [terms[kind] for kind in (cls.slope_of, cls.height_of) if kind in terms]
    if evidence.keeps or len(own) < 2:
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
    ends = [cls.straight_from, -1]
    line = np.polyfit(speed[ends], friction[ends], 1)
    fallen = float(fall / max(np.ptp(curve.values), np.finfo(float).tiny))
    return _Friction(speed, fallen, float(friction[0]), float(line[-1]))
