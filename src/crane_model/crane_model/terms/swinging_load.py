"""A load that hangs from the boom tip."""

from typing import ClassVar, Literal

import numpy as np
from pydantic import Field
from typing_extensions import override

from crane_model.array import Array
from crane_model.record import Record
from crane_model.terms.effect import Effect, Shape
from crane_model.terms.memory_term import MemoryTerm
from crane_model.terms.oscillator import relative_acceleration, swung, swung_along
from crane_model.terms.planar import AxisReach, planar_columns, planar_machine
from crane_model.terms.term import Family, Parameter, Setting


class SwingingLoad(MemoryTerm):
    """m J_x^T e'' with e'' + 2 damping w e' + w^2 e = -a_x, w = 2 pi frequency = sqrt(g/l).

    A pendulum of small angles under the boom tip (2), which accelerates by a_x away from the
    pillar; e is how far the load swings. Hanging still, e'' = 0, it is part of the mass of
    telescope and gripper (8). Swinging across the plane of the booms does not load their joints.
    """

    type: Literal["swinging_load"] = "swinging_load"
    family: ClassVar[Family] = "gravity and load"
    effect: ClassVar[Effect] = Effect(
        "swinging load",
        "a narrow band near sqrt(g/l)/2 pi on all joints that goes on when the crane stands",
        ("boom_flexibility",),
        "a recording at rest after a fast stop, with the load and without it",
        follows=("acceleration",),
    )
    shapes: ClassVar[dict[str, Shape]] = {
        "frequency": Shape(0.25, 1.2, "Hz", 14, "sqrt(g/l)/2 pi of the pendulum"),
        "damping": Shape(0.01, 0.1, "1", 2, "share of critical damping"),
    }

    frequency: float = Field(gt=0)
    damping: float = Field(gt=0, lt=1)

    @override
    def parameters(self, setting: Setting) -> tuple[Parameter, ...]:
        planar_machine(self, setting)
        return (Parameter("m_swinging", "kg", 0.0, "mass that swings under the boom tip"),)

    def start(self, record: Record, setting: Setting) -> Array:
        """e = e' = 0."""
        return np.zeros((len(record), 2))

    def advance(self, states: Array, before: Record, after: Record, setting: Setting) -> Array:
        """Exact for a step in which the tip accelerates evenly."""
        step = after.time - before.time
        push = (self._tip_velocity(after, setting) - self._tip_velocity(before, setting)) / step
        return swung(states, push, step, self.frequency, self.damping)

    def trace(self, record: Record, setting: Setting) -> Array:
        """As `advance` from sample to sample, compiled."""
        velocity, first = self._tip_velocity(record, setting), record.first_of_run
        return swung_along(velocity, record.time, first, self.frequency, self.damping)

    def fill(self, record: Record, setting: Setting, columns: Array) -> None:
        """On the rows of inner boom, outer boom and telescope."""
        tip, at = self._tip(record, setting), planar_columns(setting, record)
        carrier = np.einsum("nj,nj->n", tip.gradient, record.acceleration[:, at]) + tip.bias
        states = self.states(record, setting)
        swing = relative_acceleration(states, carrier, self.frequency, self.damping)
        columns[:, at, 0] = swing[:, np.newaxis] * tip.gradient

    def _tip(self, record: Record, setting: Setting) -> AxisReach:
        machine = planar_machine(self, setting)
        return AxisReach.of(machine, machine.as_planar().telescope_length, record)

    def _tip_velocity(self, record: Record, setting: Setting) -> Array:
        velocity = record.velocity[:, planar_columns(setting, record)]
        along: Array = np.einsum("nj,nj->n", self._tip(record, setting).gradient, velocity)
        return along
