"""Friction before a joint slides: its force builds up over a small displacement."""

import math
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


class Presliding(JointMemoryTerm):
    """f_h z with z' = (q' - |q'| z)/travel: hysteresis of Dahl (1968), |z| <= 1.

    In place of the jump of (13) at a reversal, friction changes over a displacement of about
    `travel` [rad or m], whatever the speed. A run begins at z = 0.
    """

    type: Literal["presliding"] = "presliding"
    family: ClassVar[Family] = "friction"
    effect: ClassVar[Effect] = Effect(
        "presliding hysteresis",
        "a loop against displacement after every reversal, the same at all speeds",
        ("coulomb", "stribeck", "maxwell_slip", "backlash", "time_skew"),
        "small slow strokes about one position, to and fro",
        kin=("maxwell_slip",),
        follows=("way since it turned",),
    )
    shapes: ClassVar[dict[str, Shape]] = {
        "travel": Shape(3e-4, 3e-2, "rad or m", 9, "displacement over which friction builds up")
    }

    travel: float = Field(gt=0)

    @override
    def parameter(self, coordinate: str, force: str) -> Parameter:
        return Parameter("f_h", force, 0.0, "friction that builds up over a displacement")

    def start(self, record: Record, setting: Setting) -> Array:
        """z = 0."""
        return np.zeros((len(record), 1))

    def advance(self, states: Array, before: Record, after: Record, setting: Setting) -> Array:
        """Exact for a step in one direction."""
        j = before.column(self.joint)
        way = (after.position[:, j] - before.position[:, j]) / self.travel
        return _advanced(states[:, 0], way)[:, np.newaxis]

    def column(self, states: Array, record: Record, j: int) -> Array:
        """z."""
        return states[:, 0]

    def trace(self, record: Record, setting: Setting) -> Array:
        """As `advance` from sample to sample, compiled."""
        q = record.position[:, record.column(self.joint)]
        way = np.diff(q, prepend=q[:1]) / self.travel
        return _traced(way, record.first_of_run)[:, np.newaxis]


@njit(cache=True)
def _slid(z: float, way: float) -> float:
    """z after a way in units of the travel."""
    end = 1.0 if way > 0.0 else -1.0
    return end + (z - end) * math.exp(-abs(way))


@njit(cache=True)
def _advanced(z: Array, way: Array) -> Array:
    out = np.empty_like(z)
    for n in range(len(z)):
        out[n] = _slid(z[n], way[n])
    return out


@njit(cache=True)
def _traced(way: Array, first: Flags) -> Array:
    z = np.zeros(len(way))
    for k in range(1, len(way)):
        if not first[k]:
            z[k] = _slid(z[k - 1], way[k])
    return z
