"""The controllers by name, made from what is known of a machine."""

from typing import Any

import numpy as np

from crane_model.errors import ConfigurationError
from crane_model.machine import Machine
from crane_model.model_file import Model
from crane_trajectory.control.flow_feedforward import STOP_RATE, FlowFeedforward, feedback_gains
from crane_trajectory.control.interface import ControlCondition, Controller, SensorReading, Wanted
from crane_trajectory.control.learning import Learning
from crane_trajectory.control.pd_dead_zone import GainArrays, PdDeadZone
from crane_trajectory.control.valves_and_oil import identified

PD_DEAD_ZONE = "pd_dead_zone"
OF_THE_MODEL: dict[str, dict[str, Any]] = {
    "flow_feedforward": {"pressures": False},
    "flow_and_pressures": {},
    "adaptive_flow": {"adaptive": True},
    "computed_force": {"by_force": True},
}
"""Those that need an identified model, by what makes them."""

NAMES = (PD_DEAD_ZONE, *OF_THE_MODEL)
MAY_LEARN = ("flow_feedforward", "flow_and_pressures")


def controller(
    name: str,
    machine: Machine,
    gains: GainArrays,
    model: Model | None = None,
    scale: float = 1.0,
) -> Controller:
    """The controller called `name`; `gains` are those of (36), `scale` that of all others.

    Joints that the hydraulics of `model` lack are led by (36). `ConfigurationError` if the name is
    none of `NAMES`, or the model does not have what it needs or is that of another machine.
    """
    rest = PdDeadZone(gains)
    if name == PD_DEAD_ZONE:
        return rest
    if name not in OF_THE_MODEL:
        raise ConfigurationError(f"no controller '{name}'; there are {', '.join(NAMES)}")
    if model is None or model.values is None or model.hydraulics is None:
        raise ConfigurationError(
            f"controller '{name}': needs an identified model with the hydraulics of "
            f"{machine.name}; identify it from a recording with valve commands, or use "
            f"{PD_DEAD_ZONE}"
        )
    if model.machine is None or model.machine.model_dump() != machine.model_dump():
        raise ConfigurationError(
            f"controller '{name}': model '{model.name}' was not identified with the machine "
            f"{machine.name}, as its file has it now; identify it again"
        )
    known = model.hydraulics
    joints = tuple(joint for joint in machine.joint_names if joint in known.joints)
    feedback = feedback_gains(machine, model, scale, joints)
    led = FlowFeedforward(
        machine,
        model,
        identified(machine, known, joints),
        feedback,
        joints=joints,
        **OF_THE_MODEL[name],
    )
    return led if len(joints) == len(machine.joint_names) else SideBySide(led, rest)


def led_by_model(made: Controller | None) -> FlowFeedforward | None:
    """The part of a controller that uses the model; None where there is none."""
    if isinstance(made, Learning | SideBySide):
        return made.led
    return made if isinstance(made, FlowFeedforward) else None


def learning(name: str, made: Controller, period: float) -> Learning:
    """The controller `made` by its name, which learns a motion of that period [s], too.

    `ConfigurationError` if it is none of `MAY_LEARN`.
    """
    led = led_by_model(made)
    if name not in MAY_LEARN or led is None:
        raise ConfigurationError(
            f"controller '{name}': does not learn a periodic motion; {' and '.join(MAY_LEARN)} do"
        )
    return Learning(made, led, period)


class SideBySide:
    """Some joints led by the model, the others by (36); where either stops, both do."""

    def __init__(self, led: FlowFeedforward, rest: PdDeadZone):
        self.led, self._rest = led, rest
        self.preview, self.by_model = led.preview, led.by_model
        self._last: np.ndarray | None = None

    def start(self, command: np.ndarray) -> None:
        """Take over where `command` (j,) was in force, without a jump."""
        self._last = np.array(command, dtype=float)
        self.led.start(self._last[self.led.columns])
        self._rest.start(self._last)

    def command(self, dt: float, reading: SensorReading, wanted: Wanted) -> np.ndarray:
        """As `Controller` has it."""
        u = self._rest.command(dt, reading, wanted).copy()
        u[self.led.columns] = self.led.command(dt, reading, wanted)
        if self._last is not None and any(one.stops for one in self.conditions):
            size = np.maximum(np.abs(self._last) - STOP_RATE * dt, 0.0)
            u = np.copysign(size, self._last)
        self._last = u
        return u.copy()

    @property
    def conditions(self) -> tuple[ControlCondition, ...]:
        """Of each joint, after the last command."""
        found = list(self._rest.conditions)
        for column, one in zip(self.led.columns, self.led.conditions, strict=True):
            found[column] = one
        return tuple(found)
