"""What gives way and springs back: hoses at a joint, and the boom that it moves."""

from typing import ClassVar, Literal

import numpy as np
from pydantic import Field

from crane_model.record import Record
from crane_model.terms.effect import Effect, Shape
from crane_model.terms.joint_term import JointTerm
from crane_model.terms.memory_term import JointMemoryTerm
from crane_model.terms.oscillator import relative_acceleration, swung, swung_along
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
    )

    def column(self, record: Record, j: int) -> np.ndarray:
        """q."""
        return record.position[:, j]

    def parameter(self, coordinate: str, force: str) -> Parameter:
        """k."""
        return Parameter("k_hose", f"{force}/{coordinate}", 0.0, "stiffness of hoses and cables")


class BoomFlexibility(JointMemoryTerm):
    """J e'' with e'' + 2 damping w e' + w^2 e = -q'', w = 2 pi frequency: a boom that bends.

    The first mode of what the joint carries, with the part J of its inertia. In slow motion the
    boom is rigid, e'' = 0, and J is part of the inertia (8). A run begins without ringing.
    """

    type: Literal["boom_flexibility"] = "boom_flexibility"
    family: ClassVar[Family] = "elasticity"
    effect: ClassVar[Effect] = Effect(
        "boom flexibility",
        "ringing of a few hertz after jerks, a quarter of a period late",
        ("time_skew", "swinging_load", "actuator_inertia"),
        "a fast stop at several extensions and payloads, recorded until the ringing has died out",
    )
    shapes: ClassVar[dict[str, Shape]] = {
        "frequency": Shape(0.7, 6.0, "Hz", 12, "natural frequency"),
        "damping": Shape(0.03, 0.3, "1", 3, "share of critical damping"),
    }

    frequency: float = Field(gt=0)
    damping: float = Field(gt=0, lt=1)

    def parameter(self, coordinate: str, force: str) -> Parameter:
        """J."""
        unit = "kg m2" if coordinate == "rad" else "kg"
        return Parameter("J_flexible", unit, 0.0, "inertia that takes part in the bending")

    def start(self, record: Record, setting: Setting) -> np.ndarray:
        """e = e' = 0."""
        return np.zeros((len(record), 2))

    def advance(
        self, states: np.ndarray, before: Record, after: Record, setting: Setting
    ) -> np.ndarray:
        """Exact for a step of constant acceleration."""
        j, step = before.column(self.joint), after.time - before.time
        push = (after.velocity[:, j] - before.velocity[:, j]) / step
        return swung(states, push, step, self.frequency, self.damping)

    def column(self, states: np.ndarray, record: Record, j: int) -> np.ndarray:
        """e''."""
        carrier = record.acceleration[:, j]
        return relative_acceleration(states, carrier, self.frequency, self.damping)

    def trace(self, record: Record, setting: Setting) -> np.ndarray:
        """As `advance` from sample to sample, compiled."""
        v = np.ascontiguousarray(record.velocity[:, record.column(self.joint)])
        return swung_along(v, record.time, record.first_of_run, self.frequency, self.damping)
