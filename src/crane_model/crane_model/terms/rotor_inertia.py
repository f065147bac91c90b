"""Rotors that turn fast behind a gear."""

from collections.abc import Mapping
from functools import lru_cache
from typing import ClassVar, Literal

import numpy as np

from crane_model.array import Array
from crane_model.errors import ConfigurationError
from crane_model.machine import Machine
from crane_model.record import Record
from crane_model.terms.effect import Effect
from crane_model.terms.joint_term import OneJointTerm
from crane_model.terms.term import Family, Parameter, Setting


class RotorInertia(OneJointTerm):
    """I n a'': the rotor of a drive turns by a = n q, with n its gear ratio.

    Where a coupling makes several joints turn the rotor, it acts on all of them. That the rotor is
    carried along, the gyroscopic part, is left out: it has no gear to multiply it.
    """

    type: Literal["rotor_inertia"] = "rotor_inertia"
    family: ClassVar[Family] = "rigid body"
    of_one_instant: ClassVar[bool] = True
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

    def fill(self, record: Record, setting: Setting, columns: Array) -> None:
        """On the rows of all joints that turn the rotor."""
        seen, ratio = _gear(self._machine(setting), self.joint)
        turning = sum(
            share * record.acceleration[:, record.column(joint)] for joint, share in seen.items()
        )
        for joint, share in seen.items():
            columns[:, record.column(joint), 0] = ratio**2 * share * turning

    def joint_columns(self, record: Record, setting: Setting, j: int) -> Array:
        """Those of its own joint."""
        return self.columns(record, setting)[:, j]

    def _machine(self, setting: Setting) -> Machine:
        machine = setting.machine
        if machine is None or self.joint not in machine.rotors:
            known = "the model has none" if machine is None else f"it has {_listed(machine)}"
            raise ConfigurationError(
                f"term '{self.type}': needs a machine with a motor at joint '{self.joint}'; {known}"
            )
        return machine


@lru_cache(maxsize=64)
def _gear(machine: Machine, joint: str) -> tuple[Mapping[str, float], float]:
    """Share of each joint that turns the rotor, and the ratio of the gear."""
    ratio: float = machine.cylinder(joint, np.zeros(1))[0, 1]
    return machine.seen_by(joint), ratio


def _listed(machine: Machine) -> str:
    return ", ".join(machine.rotors) or "no motor"
