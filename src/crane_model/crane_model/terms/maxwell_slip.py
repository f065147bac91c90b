"""Hysteresis as several elements side by side that stick and slip."""

from typing import ClassVar, Literal

import numpy as np
from numba import njit
from pydantic import Field

from crane_model.array import Array, Flags
from crane_model.record import Record
from crane_model.terms.effect import Effect, Shape
from crane_model.terms.joint_term import OneJointTerm
from crane_model.terms.memory_term import MemoryTerm
from crane_model.terms.term import Family, Parameter, Setting

SHARES = np.array([1 / 9, 1 / 3, 1.0])  # slip displacement of each element, per `travel`


class MaxwellSlip(MemoryTerm, OneJointTerm):
    """sum_i W_i z_i, z_i' = q'/d_i while |z_i| < 1 or it unloads: Maxwell slip (Iwan, GMS).

    Three springs k_i = W_i/d_i that slip at W_i, d_i = `travel` times 1/9, 1/3 and 1 [rad or m]:
    nested loops with the memory of turning points. A run begins relaxed, z = 0.
    """

    type: Literal["maxwell_slip"] = "maxwell_slip"
    family: ClassVar[Family] = "friction"
    effect: ClassVar[Effect] = Effect(
        "Maxwell slip",
        "nested loops against displacement that remember the turning points",
        ("stribeck", "presliding", "backlash"),
        "small slow strokes of several lengths about one position",
        kin=("presliding",),
        follows=("way since it turned",),
    )
    shapes: ClassVar[dict[str, Shape]] = {
        "travel": Shape(1e-3, 5e-2, "rad or m", 7, "displacement at which the last element slips")
    }

    travel: float = Field(gt=0)

    def joint_parameters(self, setting: Setting) -> tuple[Parameter, ...]:
        """W_1, W_2, W_3."""
        force = setting.force_unit(self.joint)
        return tuple(
            Parameter(f"W_{i + 1}", force, 0.0, f"force at which element {i + 1} slips")
            for i in range(len(SHARES))
        )

    def start(self, record: Record, setting: Setting) -> Array:
        """z = 0."""
        return np.zeros((len(record), len(SHARES)))

    def advance(self, states: Array, before: Record, after: Record, setting: Setting) -> Array:
        """Exact for a step in one direction."""
        j = before.column(self.joint)
        way = (after.position[:, j] - before.position[:, j]) / self.travel
        moved: Array = np.clip(states + way[:, np.newaxis] / SHARES, -1.0, 1.0)
        return moved

    def joint_columns(self, record: Record, setting: Setting, j: int) -> Array:
        """z (n, 3)."""
        return self.states(record, setting)

    def trace(self, record: Record, setting: Setting) -> Array:
        """As `advance` from sample to sample, compiled."""
        q = record.position[:, record.column(self.joint)]
        return _traced(np.diff(q, prepend=q[:1]) / self.travel, SHARES, record.first_of_run)


@njit(cache=True)
def _traced(way: Array, shares: Array, first: Flags) -> Array:
    z = np.zeros((len(way), len(shares)))
    for k in range(1, len(way)):
        if not first[k]:
            for i in range(len(shares)):
                z[k, i] = min(1.0, max(-1.0, z[k - 1, i] + way[k] / shares[i]))
    return z
