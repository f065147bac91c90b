"""Shapes of other forces: over the position, near the ends of the range, and fading with time."""

from typing import ClassVar, Literal

import numpy as np
from numba import njit
from pydantic import Field

from crane_model.array import Array, Flags
from crane_model.record import Record
from crane_model.terms.drawn_friction import DrawnTerm
from crane_model.terms.joint_term import MemoryTerm, OneJointTerm
from crane_model.terms.term import Family, Parameter, Setting, Variable


class DrawnPositionForce(DrawnTerm):
    """f(q), at q' of either sign, beside a constant force: 0 at the lower end."""

    type: Literal["drawn_position_force"] = "drawn_position_force"
    family: ClassVar[Family] = "elasticity"
    said: ClassVar[str] = "a force that follows the position, whatever the motion"
    draws: ClassVar[tuple[str, ...]] = ("hose_stiffness",)
    variable: ClassVar[Variable] = "position"
    spacing: ClassVar[tuple[float, ...]] = tuple(k / 8 for k in range(9))
    kept: ClassVar[tuple[int, ...]] = tuple(range(1, 9))
    times: ClassVar[tuple[str, ...]] = ("1",)
    rises: ClassVar[bool] = True

    knots: tuple[float, ...] = Field(examples=[tuple(-2.5 + 0.25 * k for k in range(9))])

    @classmethod
    def followed(cls, record: Record, j: int) -> Array:
        """q."""
        return record.position[:, j]

    def factors(self, record: Record, setting: Setting, j: int) -> Array:
        """1."""
        return np.ones((len(record), 1))

    def values_at_knot(self, k: int, coordinate: str, force: str) -> tuple[Parameter, ...]:
        """One."""
        meaning = f"force at knot {k + 1} beyond that at the lower end"
        return (Parameter(f"k_place_{k + 1}", force, None, meaning),)


class DrawnEndDamping(DrawnTerm):
    """(f(q) + h(q) |q'|) q' near both ends of the range that was moved through: 0 between."""

    type: Literal["drawn_end_damping"] = "drawn_end_damping"
    family: ClassVar[Family] = "hydraulics"
    said: ClassVar[str] = "resistance to motion near the ends of the range"
    draws: ClassVar[tuple[str, ...]] = ("end_cushioning",)
    variable: ClassVar[Variable] = "position"
    spacing: ClassVar[tuple[float, ...]] = (0.0, 0.05, 0.11, 0.2, 0.8, 0.89, 0.95, 1.0)
    kept: ClassVar[tuple[int, ...]] = (0, 1, 2, 5, 6, 7)
    times: ClassVar[tuple[str, ...]] = ("q'", "q'|q'|")

    knots: tuple[float, ...] = Field(examples=[(-2.5, -2.25, -2.0, -1.75, -1.2, -1.0, -0.7, -0.3)])

    @classmethod
    def followed(cls, record: Record, j: int) -> Array:
        """q."""
        return record.position[:, j]

    def factors(self, record: Record, setting: Setting, j: int) -> Array:
        """q' and q'|q'|."""
        v = record.velocity[:, j]
        return np.stack([v, v * np.abs(v)], axis=1)

    def values_at_knot(self, k: int, coordinate: str, force: str) -> tuple[Parameter, ...]:
        """Laminar and turbulent."""
        unit = f"{force} s/{coordinate}"
        square = f"{force} s2/{coordinate}2"
        return (
            Parameter(f"f_end_{k + 1}", unit, None, f"viscous resistance at knot {k + 1}"),
            Parameter(f"h_end_{k + 1}", square, None, f"turbulent resistance at knot {k + 1}"),
        )


class RelaxingForce(MemoryTerm, OneJointTerm):
    """sum_i k_i z_i, z_i' = q' - z_i/time_i: springs behind dampers, whose force fades at rest.

    A force that follows the position for a while and then forgets it is no hose of `k q` and no
    friction: it has a signature, and no effect of the catalogue has it.
    """

    type: Literal["relaxing_force"] = "relaxing_force"
    family: ClassVar[Family] = "elasticity"
    stranger: ClassVar[str] = "a force that follows the position and fades within seconds"

    times: tuple[float, ...] = Field(default=(0.3, 1.0, 3.0, 9.0), min_length=1)

    def joint_parameters(self, setting: Setting) -> tuple[Parameter, ...]:
        """The stiffness of each spring."""
        unit = f"{setting.force_unit(self.joint)}/{setting.units[self.joint]}"
        return tuple(
            Parameter(f"k_fading_{i + 1}", unit, None, f"stiffness that fades within {time:g} s")
            for i, time in enumerate(self.times)
        )

    def start(self, record: Record, setting: Setting) -> Array:
        """Relaxed."""
        return np.zeros((len(record), len(self.times)))

    def advance(self, states: Array, before: Record, after: Record, setting: Setting) -> Array:
        """Exact for a step of constant velocity."""
        j, step = before.column(self.joint), after.time - before.time
        way = after.position[:, j] - before.position[:, j]
        share = step[:, np.newaxis] / np.array(self.times)
        kept = np.exp(-share)
        moved: Array = states * kept + way[:, np.newaxis] * (1.0 - kept) / share
        return moved

    def trace(self, record: Record, setting: Setting) -> Array:
        """As `advance` from sample to sample, compiled."""
        q = record.position[:, record.column(self.joint)]
        way = np.diff(q, prepend=q[:1])
        step = np.diff(record.time, prepend=record.time[:1])
        return _traced(way, step, np.array(self.times), record.first_of_run)

    def joint_columns(self, record: Record, setting: Setting, j: int) -> Array:
        """z (n, springs)."""
        return self.states(record, setting)


@njit(cache=True)
def _traced(way: Array, step: Array, times: Array, first: Flags) -> Array:
    z = np.zeros((len(way), len(times)))
    for k in range(1, len(way)):
        if not first[k]:
            for i in range(len(times)):
                share = step[k] / times[i]
                kept = np.exp(-share)
                z[k, i] = z[k - 1, i] * kept + way[k] * (1.0 - kept) / share
    return z
