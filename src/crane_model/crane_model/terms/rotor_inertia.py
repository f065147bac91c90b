"""Rotors that turn fast behind a gear."""

from functools import lru_cache
from typing import ClassVar, Literal

import numpy as np

from crane_model.errors import ConfigurationError
from crane_model.machine import Machine
from crane_model.motion_columns import MotionColumn, MotionQuantity
from crane_model.terms.effect import Effect
from crane_model.terms.joint_term import MotionTerm
from crane_model.terms.term import Family, Parameter, Setting


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
