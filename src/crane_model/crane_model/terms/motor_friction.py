"""Friction of motors that several joints turn at once, as in the hollow wrist of a robot."""

from collections.abc import Mapping
from typing import ClassVar, Literal

import numpy as np

from crane_model.array import Array
from crane_model.errors import ConfigurationError
from crane_model.motion_columns import MotionColumn, MotionQuantity
from crane_model.record import Record
from crane_model.terms.joint_term import MotionTerm, OneJointTerm
from crane_model.terms.term import Family, Parameter, Setting


class MotorViscous(MotionTerm):
    """f c_i (c q'): the motor of a coupling turns by c q, c its row of the coupling's matrix.

    Its friction f c q' acts on each joint that turns the motor, by virtual work. Friction in the
    joints themselves is that of `viscous`, beside it.
    """

    type: Literal["motor_viscous"] = "motor_viscous"
    family: ClassVar[Family] = "friction"

    def joint_parameters(self, setting: Setting) -> tuple[Parameter, ...]:
        """f, before the gear."""
        seen_by_motor(self.type, self.joint, setting)
        unit = f"{setting.force_unit(self.joint)} s/{setting.units[self.joint]}"
        return (Parameter("f_v_motor", unit, 0.0, "viscous friction of the motor"),)

    def motion_columns(self, setting: Setting) -> tuple[MotionColumn, ...]:
        """On the rows of all joints that turn the motor."""
        seen = seen_by_motor(self.type, self.joint, setting)
        return tuple(
            MotionColumn(row, 0, MotionQuantity.VELOCITY, turning, own * share)
            for row, own in seen.items()
            for turning, share in seen.items()
        )


class MotorCoulomb(OneJointTerm):
    """f c_i sgn(c q'): dry friction of a motor that turns by c q, as of `motor_viscous`."""

    type: Literal["motor_coulomb"] = "motor_coulomb"
    family: ClassVar[Family] = "friction"
    of_one_instant: ClassVar[bool] = True

    def joint_parameters(self, setting: Setting) -> tuple[Parameter, ...]:
        """f, before the gear."""
        seen_by_motor(self.type, self.joint, setting)
        force = setting.force_unit(self.joint)
        return (Parameter("f_c_motor", force, 0.0, "Coulomb friction of the motor"),)

    def turned_by(self, setting: Setting) -> Mapping[str, float]:
        """The joints of the coupling."""
        return seen_by_motor(self.type, self.joint, setting)

    def fill(self, record: Record, setting: Setting, columns: Array) -> None:
        """On the rows of all joints that turn the motor."""
        seen = seen_by_motor(self.type, self.joint, setting)
        at, shares = [record.column(joint) for joint in seen], np.array(list(seen.values()))
        speed = record.velocity[:, at] @ shares
        direction = np.sign(speed)
        if record.velocity_resolution is not None:
            unsure = np.abs(shares) @ record.velocity_resolution[at]
            direction[np.abs(speed) < unsure] = 0.0
        columns[:, at, 0] = direction[:, np.newaxis] * shares

    def joint_columns(self, record: Record, setting: Setting, j: int) -> Array:
        """Those of its own joint."""
        return self.columns(record, setting)[:, j]


def seen_by_motor(term: str, joint: str, setting: Setting) -> Mapping[str, float]:
    """The joints that turn the motor of `joint` and their shares; `ConfigurationError` if that is
    in no coupling, or the model lacks one of them.
    """
    machine = setting.machine
    coupled = [] if machine is None else [one for part in machine.couplings for one in part.joints]
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
