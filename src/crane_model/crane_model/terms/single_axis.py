"""Terms that, with friction, describe any one-axis machine."""

from typing import ClassVar, Literal

import numpy as np

from crane_model.record import Record
from crane_model.terms.effect import Effect
from crane_model.terms.joint_term import JointTerm
from crane_model.terms.term import Family, Parameter


class Inertia(JointTerm):
    """J q'': the inertia that one axis moves."""

    type: Literal["inertia"] = "inertia"
    family: ClassVar[Family] = "rigid body"

    def column(self, record: Record, j: int) -> np.ndarray:
        """q''."""
        return record.acceleration[:, j]

    def parameter(self, coordinate: str, force: str) -> Parameter:
        """Moment of inertia of a revolute joint, mass of a prismatic one."""
        unit = "kg m2" if coordinate == "rad" else "kg"
        return Parameter("inertia", unit, 0.0, "inertia moved by the joint")


class Offset(JointTerm):
    """tau = f_0, a constant force: the drive's or the sensor's zero."""

    type: Literal["offset"] = "offset"
    family: ClassVar[Family] = "sensing"
    effect: ClassVar[Effect] = Effect(
        "constant force",
        "a constant force, whatever the motion",
        ("coulomb_asymmetry", "pressure_offset"),
        "readings of the force sensors without load",
    )

    def column(self, record: Record, j: int) -> np.ndarray:
        """1."""
        return np.ones(len(record))

    def parameter(self, coordinate: str, force: str) -> Parameter:
        """The constant."""
        return Parameter("offset", force, None, "constant force")
