"""Inertia of the drive itself."""

from typing import ClassVar, Literal

from crane_model.array import Array
from crane_model.errors import ConfigurationError
from crane_model.record import Record
from crane_model.terms.chambers import lever_and_slope
from crane_model.terms.effect import Effect
from crane_model.terms.joint_term import OneJointTerm
from crane_model.terms.term import Family, Parameter, Setting


class ActuatorInertia(OneJointTerm):
    """m x'' dx/dq: piston, rod and oil of mass m move by x(q) of (20), (24).

    x'' = dx/dq q'' + d2x/dq2 q'^2; without a machine x = q, and m is an inertia of the joint.
    """

    type: Literal["actuator_inertia"] = "actuator_inertia"
    family: ClassVar[Family] = "rigid body"
    effect: ClassVar[Effect] = Effect(
        "inertia of the actuator",
        "force with the acceleration of its own joint only",
        ("time_skew", "boom_flexibility"),
        "fast motion of one joint at a time; on the inner boom only the weight of the drive",
        follows=("acceleration",),
    )

    def joint_parameters(self, setting: Setting) -> tuple[Parameter, ...]:
        """m; `ConfigurationError` for a motor, whose rotor has an inertia and no mass."""
        if setting.machine is not None and self.joint in setting.machine.rotors:
            raise ConfigurationError(
                f"term '{self.type}': a motor drives '{self.joint}': use the term 'rotor_inertia'"
            )
        rotary = setting.machine is None and setting.units[self.joint] == "rad"
        unit = "kg m2" if rotary else "kg"
        return (Parameter("m_drive", unit, 0.0, "mass that moves with the piston"),)

    def joint_columns(self, record: Record, setting: Setting, j: int) -> Array:
        """x'' dx/dq."""
        arm, slope = lever_and_slope(setting, self.joint, record)
        return arm * (arm * record.acceleration[:, j] + slope * record.velocity[:, j] ** 2)
