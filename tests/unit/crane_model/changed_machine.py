"""Machines that differ from a sound one in what drives a joint, checked or not."""

from typing import Any

from crane_model import Machine


def with_actuator(machine: Machine, joint: str, **update: Any) -> Machine:
    """The machine with other constants of one actuator, even such as its file may not have."""
    actuator = machine.actuators[joint].model_copy(update=update)
    joints = [
        one.model_copy(update={"actuator": actuator}) if one.name == joint else one
        for one in machine.joints
    ]
    return machine.model_copy(update={"joints": tuple(joints)})
