"""What gives way and springs back: hoses at a joint, and the boom that it moves."""

from typing import ClassVar, Literal

import numpy as np
from pydantic import Field
from typing_extensions import override

from crane_model.array import Array
from crane_model.record import Record
from crane_model.terms.bending import Bend, bending_forces, bent, bent_along, sagging
from crane_model.terms.effect import Effect, Shape
from crane_model.terms.joint_term import JointTerm, OneJointTerm
from crane_model.terms.memory_term import MemoryTerm
from crane_model.terms.oscillator import relative_acceleration, swung, swung_along
from crane_model.terms.planar import planar_columns, planar_machine, plane_of
from crane_model.terms.term import Family, Parameter, Setting


class HoseStiffness(JointTerm):
    """k q: hoses and cables that bend with the joint; where they are relaxed, k q_0, is constant.

    That constant is the asymmetry of Coulomb friction (13), which a model holds beside it.
    """

    type: Literal["hose_stiffness"] = "hose_stiffness"
    family: ClassVar[Family] = "elasticity"
    effect: ClassVar[Effect] = Effect(
        "hose stiffness",
        "force in proportion to the position, whatever load and speed",
        ("pressure_offset", "encoder_offset"),
        "poses at rest over the whole range, with hoses connected and disconnected",
        follows=("position",),
    )

    def column(self, record: Record, j: int) -> Array:
        """q."""
        return record.position[:, j]

    @override
    def parameter(self, coordinate: str, force: str) -> Parameter:
        return Parameter("k_hose", f"{force}/{coordinate}", 0.0, "stiffness of hoses and cables")


class BoomFlexibility(OneJointTerm, MemoryTerm):
    """J/I (phi(q + e) - phi(q)): a boom that bends by e, and deflects all that hangs behind it.

    phi = J_tip^T (r'' + g) is what a mass of 1 kg at the boom tip (2) asks of the joints, I its
    inertia about the joint in the middle of all ranges. There, the spring that bends has this
    frequency; phi_joint(q + e) = -kappa e - delta e' makes e follow the load, which sags, and ring.
    A model without the planar crane knows no weight and no other joint: J e'' with
    e'' + 2 damping w e' + w^2 e = -q'', w = 2 pi frequency.
    """

    type: Literal["boom_flexibility"] = "boom_flexibility"
    family: ClassVar[Family] = "elasticity"
    effect: ClassVar[Effect] = Effect(
        "boom flexibility",
        "sagging under the load and ringing after jerks, on every joint that the bend moves",
        ("time_skew", "swinging_load", "actuator_inertia"),
        "a fast stop at several extensions and payloads, recorded until the ringing has died out",
        follows=("acceleration",),
    )
    shapes: ClassVar[dict[str, Shape]] = {
        "frequency": Shape(0.7, 12.0, "Hz", 16, "natural frequency"),
        "damping": Shape(0.03, 0.3, "1", 2, "share of critical damping"),
    }

    frequency: float = Field(gt=0)
    damping: float = Field(gt=0, lt=1)

    @override
    def joint_parameters(self, setting: Setting) -> tuple[Parameter, ...]:
        unit = "kg m2" if setting.units[self.joint] == "rad" else "kg"
        return (Parameter("J_flexible", unit, 0.0, "inertia that takes part in the bending"),)

    def start(self, record: Record, setting: Setting) -> Array:
        """Sagging at rest."""
        bend = self._bend(setting)
        if bend is None:
            return np.zeros((len(record), 2))
        return sagging(bend, record.position[:, planar_columns(setting, record)])

    def advance(self, states: Array, before: Record, after: Record, setting: Setting) -> Array:
        """Over a step of constant acceleration and, but for the oscillator, of constant load."""
        bend, step = self._bend(setting), after.time - before.time
        push = (after.velocity - before.velocity) / step[:, np.newaxis]
        if bend is None:
            own = push[:, before.column(self.joint)]
            return swung(states, own, step, self.frequency, self.damping)
        at = planar_columns(setting, before)
        q, v = (
            (one[:, at] + other[:, at]) / 2.0
            for one, other in (
                (before.position, after.position),
                (before.velocity, after.velocity),
            )
        )
        return bent(bend, states, q, v, push[:, at], step)

    def trace(self, record: Record, setting: Setting) -> Array:
        """As `advance` from sample to sample, compiled."""
        bend, first = self._bend(setting), record.first_of_run
        if bend is None:
            v = np.ascontiguousarray(record.velocity[:, record.column(self.joint)])
            return swung_along(v, record.time, first, self.frequency, self.damping)
        at = planar_columns(setting, record)
        return bent_along(bend, record.position[:, at], record.velocity[:, at], record.time, first)

    def fill(self, record: Record, setting: Setting, columns: Array) -> None:
        """On the rows of all planar joints, or without them on that of its own."""
        bend = self._bend(setting)
        if bend is None:
            super().fill(record, setting, columns)
            return
        at, states = planar_columns(setting, record), self.states(record, setting)
        motion = record.position[:, at], record.velocity[:, at], record.acceleration[:, at]
        columns[:, at, 0] = bending_forces(bend, states, *motion) / bend.inertia

    def joint_columns(self, record: Record, setting: Setting, j: int) -> Array:
        """e''."""
        states = self.states(record, setting)
        carrier = record.acceleration[:, j]
        return relative_acceleration(states, carrier, self.frequency, self.damping)

    def _bend(self, setting: Setting) -> Bend | None:
        """How the planar crane bends; None in a model without it, and for the slew."""
        if self.joint not in plane_of(setting):
            return None
        return Bend.of(planar_machine(self, setting), self.joint, self.frequency, self.damping)
