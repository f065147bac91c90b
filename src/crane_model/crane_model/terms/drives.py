"""Inertia and friction of drives: rotors behind a gear, pistons, and motors that joints share."""

from collections.abc import Mapping
from functools import lru_cache
from typing import Literal

import numpy as np

from crane_model.array import Array
from crane_model.errors import ConfigurationError
from crane_model.machine import Machine
from crane_model.motion_columns import MotionColumn, MotionQuantity
from crane_model.record import Record
from crane_model.terms.joint_term import MotionTerm, OneJointTerm, lever_and_slope
from crane_model.terms.term import Effect, Parameter, Setting


class RotorInertia(MotionTerm):
    """I n a'': the rotor of a drive turns by a = n q, with n its gear ratio.

    Where a coupling makes several joints turn the rotor, it acts on all of them. That the rotor is
    carried along, the gyroscopic part, is left out: it has no gear to multiply it.
    """

    type: Literal["rotor_inertia"] = "rotor_inertia"
    family = "rigid body"
    effect = Effect(
        "inertia of a rotor",
        "force with the acceleration of its own joint only",
        (),
        "fast motion of one joint at a time",
        follows=("acceleration",),
    )

    def joint_parameters(self, setting: Setting) -> tuple[Parameter, ...]:
        machine = self._machine(setting)
        if lacking := machine.seen_by(self.joint).keys() - setting.units.keys():
            raise ConfigurationError(
                f"term '{self.type}': the rotor of '{self.joint}' also turns with "
                f"{', '.join(sorted(lacking))}, which the model lacks"
            )
        return (Parameter("I_rotor", "kg m2", 0.0, "inertia of the rotor of the drive"),)

    def motion_columns(self, setting: Setting) -> tuple[MotionColumn, ...]:
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
        MotionColumn(row, 0, MotionQuantity.ACCELERATION, turning, gear**2 * own_share * share)
        for row, own_share in seen.items()
        for turning, share in seen.items()
    )


def _listed(machine: Machine) -> str:
    return ", ".join(machine.rotors) or "no motor"


class ActuatorInertia(OneJointTerm):
    """m x'' dx/dq: piston, rod and oil of mass m move by x(q) of (20), (24).

    x'' = dx/dq q'' + d2x/dq2 q'^2; without a machine x = q, and m is an inertia of the joint.
    """

    type: Literal["actuator_inertia"] = "actuator_inertia"
    family = "rigid body"
    effect = Effect(
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
        arm, slope = lever_and_slope(setting, self.joint, record)
        return arm * (arm * record.acceleration[:, j] + slope * record.velocity[:, j] ** 2)


# Friction of motors that several joints turn at once, as in the hollow wrist of a robot.


class MotorViscous(MotionTerm):
    """f c_i (c q'): the motor of a coupling turns by c q, c its row of the coupling's matrix.

    Its friction f c q' acts on each joint that turns the motor, by virtual work. Friction in the
    joints themselves is that of `viscous`, beside it.
    """

    type: Literal["motor_viscous"] = "motor_viscous"
    family = "friction"

    def joint_parameters(self, setting: Setting) -> tuple[Parameter, ...]:
        seen_by_motor(self.type, self.joint, setting)
        unit = f"{setting.force_unit(self.joint)} s/{setting.units[self.joint]}"
        return (Parameter("f_v_motor", unit, 0.0, "viscous friction of the motor"),)

    def motion_columns(self, setting: Setting) -> tuple[MotionColumn, ...]:
        seen = seen_by_motor(self.type, self.joint, setting)
        return tuple(
            MotionColumn(row, 0, MotionQuantity.VELOCITY, turning, own_share * share)
            for row, own_share in seen.items()
            for turning, share in seen.items()
        )


class MotorCoulomb(OneJointTerm):
    """f c_i sgn(c q'): dry friction of a motor that turns by c q, as of `motor_viscous`."""

    type: Literal["motor_coulomb"] = "motor_coulomb"
    family = "friction"
    of_one_instant = True

    def joint_parameters(self, setting: Setting) -> tuple[Parameter, ...]:
        seen_by_motor(self.type, self.joint, setting)
        force = setting.force_unit(self.joint)
        return (Parameter("f_c_motor", force, 0.0, "Coulomb friction of the motor"),)

    def turned_by(self, setting: Setting) -> Mapping[str, float]:
        return seen_by_motor(self.type, self.joint, setting)

    def fill(self, record: Record, setting: Setting, columns: Array) -> None:
        seen = seen_by_motor(self.type, self.joint, setting)
        at, shares = [record.column(joint) for joint in seen], np.array(list(seen.values()))
        speed = record.velocity[:, at] @ shares
        direction = np.sign(speed)
        if record.velocity_resolution is not None:
            unsure = np.abs(shares) @ record.velocity_resolution[at]
            direction[np.abs(speed) < unsure] = 0.0
        columns[:, at, 0] = direction[:, np.newaxis] * shares

    def joint_columns(self, record: Record, setting: Setting, j: int) -> Array:
        return self.columns(record, setting)[:, j]


def seen_by_motor(term: str, joint: str, setting: Setting) -> Mapping[str, float]:
    """Joints that turn the motor of `joint`, and their shares; `ConfigurationError` if none."""
    machine = setting.machine
    coupled = (
        [] if machine is None else [name for part in machine.couplings for name in part.joints]
    )
    if machine is None or joint not in coupled:
        raise ConfigurationError(
            f"term '{term}': joint '{joint}' is in no coupling of the machine, which has "
            f"{', '.join(coupled) or 'none'}; add it to `couplings`, or use the friction of joints"
        )
    seen = machine.seen_by(joint)
    if lacking := seen.keys() - setting.units.keys():
        raise ConfigurationError(
            f"term '{term}': the motor of '{joint}' also turns with "
            f"{', '.join(sorted(lacking))}, which the model lacks"
        )
    return seen
