"""Rigid-body terms."""

from functools import lru_cache
from typing import ClassVar, Literal

import numpy as np

from crane_model.array import Array
from crane_model.base_parameters import lagrangian_from_standard, standard_from_chain
from crane_model.dynamics import Geometry, fill_base_regressor, pull_back
from crane_model.errors import ConfigurationError
from crane_model.machine import Machine
from crane_model.motion_columns import MotionColumn, MotionQuantity
from crane_model.record import Record
from crane_model.terms.chambers import lever_and_slope
from crane_model.terms.gravity_and_load import planar_columns, planar_machine
from crane_model.terms.joint_term import MotionTerm, OneJointTerm
from crane_model.terms.term import Effect, Family, Parameter, Setting, Term


class PlanarRigidBody(Term):
    """M(q) q'' + C(q, q') q' + G(q) of (7), linear in the eight base parameters (8).

    The centre of mass of telescope and gripper lies on the telescope's axis, so that its normal
    moment about the elbow is a3 m_TL and not a parameter of its own.
    """

    type: Literal["planar_rigid_body"] = "planar_rigid_body"
    family: ClassVar[Family] = "rigid body"
    has_base_parameters: ClassVar[bool] = True
    of_one_instant: ClassVar[bool] = True

    def parameters(self, setting: Setting) -> tuple[Parameter, ...]:
        """The base set of the suite, each named as the combination that it is."""
        planar_machine(self, setting)
        return BASE_PARAMETERS

    def of_bodies(self, setting: Setting) -> Array | None:
        """The base set from the bodies of the chain."""
        machine = planar_machine(self, setting)
        lagrangian = lagrangian_from_standard(Geometry.of(machine))
        bodies: Array = lagrangian[: len(BASE_PARAMETERS)] @ standard_from_chain(machine)
        return bodies

    def fill(self, record: Record, setting: Setting, columns: Array) -> None:
        """On the rows of inner boom, outer boom and telescope."""
        geometry = Geometry.of(planar_machine(self, setting))
        motion = record.position, record.velocity, record.acceleration
        fill_base_regressor(geometry, *motion, planar_columns(setting, record), columns)

    def pull_back(self, record: Record, setting: Setting, weight: Array) -> Array:
        """In closed form."""
        geometry = Geometry.of(planar_machine(self, setting))
        at = planar_columns(setting, record)
        motion = record.position, record.velocity, record.acceleration
        q, v, acceleration = (each[:, at] for each in motion)
        slopes = np.zeros((3, *record.position.shape))
        slopes[:, :, at] = pull_back(geometry, q, v, acceleration, weight[:, at])
        return slopes


BASE_PARAMETERS = (
    Parameter(
        "J_FL",
        "kg m2",
        0.0,
        "inertia of the inner boom about joint 2 + a2^2 times the mass of outer boom, telescope "
        "and gripper",
    ),
    Parameter(
        "S_FL_along",
        "kg m",
        None,
        "mass moment of the inner boom along the line from joint 2 to the elbow + a2 times the "
        "mass of outer boom, telescope and gripper",
    ),
    Parameter("S_FL_normal", "kg m", None, "mass moment of the inner boom normal to that line"),
    Parameter(
        "J_SL",
        "kg m2",
        0.0,
        "inertia of outer boom, telescope and gripper about the elbow at q4 = 0",
    ),
    Parameter(
        "S_SL_along",
        "kg m",
        None,
        "mass moment of outer boom, telescope and gripper about the elbow along the telescope's "
        "axis at q4 = 0",
    ),
    Parameter(
        "S_SL_normal",
        "kg m",
        None,
        "mass moment of outer boom, telescope and gripper about the elbow normal to the "
        "telescope's axis",
    ),
    Parameter("m_TL", "kg", 0.0, "mass of telescope and gripper"),
    Parameter(
        "S_TL_along",
        "kg m",
        None,
        "mass moment of telescope and gripper along the telescope's axis, from the elbow at q4 = 0",
    ),
)

LAGRANGIAN = (
    *BASE_PARAMETERS,
    Parameter(
        "S_TL_normal",
        "kg m",
        None,
        "mass moment of telescope and gripper about the elbow normal to the telescope's axis",
    ),
)
"""Those of `crane_model.dynamics`: the base set where that moment does not follow from the mass."""


# Rotors that turn fast behind a gear.


class RotorInertia(MotionTerm):
    """I n a'': the rotor of a drive turns by a = n q, with n its gear ratio.

    Where a coupling makes several joints turn the rotor, it acts on all of them. That the rotor is
    carried along, the gyroscopic part, is left out: it has no gear to multiply it.
    """

    type: Literal["rotor_inertia"] = "rotor_inertia"
    family: ClassVar[Family] = "rigid body"
    effect: ClassVar[Effect] = Effect(
        "inertia of a rotor",
        "force with the acceleration of its own joint only",
        (),
        "fast motion of one joint at a time",
        follows=("acceleration",),
    )

    def joint_parameters(self, setting: Setting) -> tuple[Parameter, ...]:
        """I of the rotor itself."""
        machine = self._machine(setting)
        if lacking := machine.seen_by(self.joint).keys() - setting.units.keys():
            raise ConfigurationError(
                f"term '{self.type}': the rotor of '{self.joint}' also turns with "
                f"{', '.join(sorted(lacking))}, which the model lacks"
            )
        return (Parameter("I_rotor", "kg m2", 0.0, "inertia of the rotor of the drive"),)

    def motion_columns(self, setting: Setting) -> tuple[MotionColumn, ...]:
        """On the rows of all joints that turn the rotor."""
        return _columns(self._machine(setting), self.joint)

    def _machine(self, setting: Setting) -> Machine:
        machine = setting.machine
        if machine is None or self.joint not in machine.rotors:
            known = "the model has none" if machine is None else f"it has {_listed(machine)}"
            raise ConfigurationError(
                f"term '{self.type}': needs a machine with a motor at joint '{self.joint}'; {known}"
            )
        return machine


@lru_cache(maxsize=64)
def _columns(machine: Machine, joint: str) -> tuple[MotionColumn, ...]:
    seen = machine.seen_by(joint)
    gear: float = machine.cylinder(joint, np.zeros(1))[0, 1]
    return tuple(
        MotionColumn(row, 0, MotionQuantity.ACCELERATION, turning, gear**2 * own * share)
        for row, own in seen.items()
        for turning, share in seen.items()
    )


def _listed(machine: Machine) -> str:
    return ", ".join(machine.rotors) or "no motor"


# Inertia of the drive itself.


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
