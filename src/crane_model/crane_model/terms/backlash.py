"""Play between a cylinder and its joint."""

from typing import ClassVar, Literal

import numpy as np
from numba import njit
from pydantic import Field
from typing_extensions import override

from crane_model.array import Array, Flags
from crane_model.record import Record
from crane_model.terms.effect import Effect, Shape
from crane_model.terms.memory_term import JointMemoryTerm
from crane_model.terms.term import Family, Parameter, Setting


class Backlash(JointMemoryTerm):
    """f_g (z - c)/2, c = sgn(tau), z' = 2 c|q'|/clearance until z = c: load not yet taken up.

    z in [-1, 1] is where a pin stands in its clearance. After the load has reversed, the joint
    moves by `clearance` [rad or m] until the pin is seated again; on the way the drive lacks the
    force f_g on the new side. A run begins seated.
    """

    type: Literal["backlash"] = "backlash"
    family: ClassVar[Family] = "elasticity"
    effect: ClassVar[Effect] = Effect(
        "backlash",
        "force is missing over a short displacement after the load, not the speed, reverses",
        ("presliding", "maxwell_slip"),
        "slow strokes with a load that does not reverse, then with one that does",
        follows=("force",),
    )
    shapes: ClassVar[dict[str, Shape]] = {
        "clearance": Shape(5e-4, 2e-2, "rad or m", 7, "motion of the joint across the clearance")
    }

    clearance: float = Field(gt=0)

    @override
    def parameter(self, coordinate: str, force: str) -> Parameter:
        return Parameter("f_g", force, 0.0, "force that is missing until the clearance is crossed")

    def start(self, record: Record, setting: Setting) -> Array:
        """Seated on the side of the load."""
        return np.sign(self._load(record))[:, np.newaxis]

    def advance(self, states: Array, before: Record, after: Record, setting: Setting) -> Array:
        """Towards the side of the load at the end of the step."""
        j = before.column(self.joint)
        way = 2.0 * (after.position[:, j] - before.position[:, j]) / self.clearance
        return _advanced(states[:, 0], way, self._load(after))[:, np.newaxis]

    def column(self, states: Array, record: Record, j: int) -> Array:
        """(z - c)/2; 0 without load."""
        load = self._load(record)
        return np.where(load == 0.0, 0.0, (states[:, 0] - np.sign(load)) / 2.0)

    def trace(self, record: Record, setting: Setting) -> Array:
        """As `advance` from sample to sample, compiled."""
        q = record.position[:, record.column(self.joint)]
        way = 2.0 * np.diff(q, prepend=q[:1]) / self.clearance
        return _traced(way, self._load(record), record.first_of_run)[:, np.newaxis]

    def _load(self, record: Record) -> Array:
        return self.needed(record, "force")[:, record.column(self.joint)]


@njit(cache=True)
def _crossed(z: float, way: float, load: float) -> float:
    """z after a way in units of half the clearance, under a load."""
    if load == 0.0:
        return z
    side = 1.0 if load > 0.0 else -1.0
    return z + min(abs(way), max(-abs(way), side - z))


@njit(cache=True)
def _advanced(z: Array, way: Array, load: Array) -> Array:
    out = np.empty_like(z)
    for n in range(len(z)):
        out[n] = _crossed(z[n], way[n], load[n])
    return out


@njit(cache=True)
def _traced(way: Array, load: Array, first: Flags) -> Array:
    z = np.sign(load)
    for k in range(1, len(way)):
        if not first[k]:
            z[k] = _crossed(z[k - 1], way[k], load[k])
    return z
