"""Terms that, with friction, describe any one-axis machine."""

from typing import ClassVar, Literal

import numpy as np

from crane_model.array import Array
from crane_model.errors import ConfigurationError
from crane_model.motion_columns import MotionQuantity
from crane_model.record import Record
from crane_model.terms.joint_term import OneJointTerm, ProportionalTerm
from crane_model.terms.term import Effect, Family, Parameter, Setting


class Inertia(ProportionalTerm):
    """J q'': the inertia that one axis moves."""

    type: Literal["inertia"] = "inertia"
    family: ClassVar[Family] = "rigid body"
    quantity: ClassVar[MotionQuantity] = MotionQuantity.ACCELERATION

    def parameter(self, coordinate: str, force: str) -> Parameter:
        """Moment of inertia of a revolute joint, mass of a prismatic one."""
        unit = "kg m2" if coordinate == "rad" else "kg"
        return Parameter("inertia", unit, 0.0, "inertia moved by the joint")


class Gravity(OneJointTerm):
    """tau = g_s sin q + g_c cos q: weight on a body that turns about one horizontal axis.

    For a mass m at the distance r from the axis, q0 above the horizontal where q = 0:
    g_c = m g r cos q0, g_s = -m g r sin q0. It knows nothing of axes that carry this one.
    """

    type: Literal["gravity"] = "gravity"
    family: ClassVar[Family] = "gravity and load"

    def joint_parameters(self, setting: Setting) -> tuple[Parameter, ...]:
        """g_s, g_c; `ConfigurationError` for a joint that does not turn."""
        if setting.units[self.joint] != "rad":
            raise ConfigurationError(
                f"term 'gravity': joint '{self.joint}' slides, its weight is a constant force: use "
                "the term 'offset'"
            )
        return (
            Parameter("g_s", "N m", None, "weight times lever at q = 90 degrees"),
            Parameter("g_c", "N m", None, "weight times lever at q = 0"),
        )

    def joint_columns(self, record: Record, setting: Setting, j: int) -> Array:
        """sin q, cos q: (n, 2)."""
        q = record.position[:, j]
        return np.stack([np.sin(q), np.cos(q)], axis=1)


class Offset(ProportionalTerm):
    """tau = f_0, a constant force: the drive's or the sensor's zero."""

    type: Literal["offset"] = "offset"
    family: ClassVar[Family] = "sensing"
    effect: ClassVar[Effect] = Effect(
        "constant force",
        "a constant force, whatever the motion",
        ("coulomb_asymmetry", "pressure_offset"),
        "readings of the force sensors without load",
    )
    quantity: ClassVar[MotionQuantity] = MotionQuantity.ONE

    def parameter(self, coordinate: str, force: str) -> Parameter:
        """f_0, of either sign."""
        return Parameter("offset", force, None, "constant force")
