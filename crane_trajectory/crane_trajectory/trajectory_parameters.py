"""The parameters of the trajectory node: declared with unit and range, checked as a whole."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from rclpy.node import Node

from crane_model.configuration import bounds, validate
from crane_model.machine import JOINT_UNITS, JOINTS
from crane_nodes.managed import AUTOSTART
from crane_nodes.parameters import Number, Text
from crane_trajectory.control.controller import Gains, JointGains, load_gains
from crane_trajectory.control.tuning import Tuning

# Reference minus measured position. In the simulated crane the largest errors are about half.
TOLERANCE = {"slew": 0.1, "inner_boom": 0.1, "outer_boom": 0.2, "telescope": 0.1}
GAIN_MEANINGS = {  # unit with U for that of the joint, meaning
    "kp": ("1/U", "Command per position error"),
    "kd": ("s/U", "Command per velocity error"),
    "dead_zone_positive": ("-", "F_f: command at which the valve opens upwards"),
    "dead_zone_negative": ("-", "F_f: command at which the valve opens downwards"),
    "standstill_speed": ("U/s", "Speed below which its sign is not trusted"),
    "position_tolerance": ("U", "Error that a crane at rest is left with"),
}
LIVE = ". Changeable while running"

MACHINE = Text(
    "machine", "", "Machine file with the limits; empty: the laboratory crane. At configure"
)
CLEARANCE = Text(
    "clearance", "", "File of the room that the boom tip keeps; empty: packaged. At configure"
)
CONTROLLER = Text(
    "controller",
    "",
    "File of the gains, for each that is not given by itself; empty: packaged. At configure",
)
STATES_TIMEOUT = Number(
    "states_timeout",
    0.06,
    "s",
    0.01,
    1.0,
    "Silence of joint_states after which the crane is brought to rest. At configure",
)
SATURATION = Number("saturation", 1.0, "-", 0.01, 1.0, f"Largest spool command{LIVE}")
FIXED = (AUTOSTART, MACHINE, CLEARANCE, CONTROLLER, STATES_TIMEOUT)


def _gain(joint: str, field: str, default: float) -> Number:
    unit, meaning = GAIN_MEANINGS[field]
    unit = unit.replace("U", JOINT_UNITS[joint])
    lowest, highest = bounds(JointGains, field)
    return Number(f"gains.{joint}.{field}", default, unit, lowest, highest, f"{meaning}{LIVE}")


def _gain_parameters() -> dict[str, dict[str, Number]]:
    gains = load_gains().model_dump()
    return {
        joint: {field: _gain(joint, field, value) for field, value in gains[joint].items()}
        for joint in JOINTS
    }


GAINS = _gain_parameters()
TOLERANCES = {
    joint: Number(
        f"tracking_tolerance.{joint}",
        tolerance,
        JOINT_UNITS[joint],
        1e-4,
        2.0,
        f"Distance from the reference at which the crane is brought to rest{LIVE}",
    )
    for joint, tolerance in TOLERANCE.items()
}
SINGLE_GAINS = tuple(parameter for joint in GAINS.values() for parameter in joint.values())
CHANGEABLE = (SATURATION, *TOLERANCES.values(), *SINGLE_GAINS)


def values_of(gains: Gains) -> dict[str, float]:
    """The gains by the names of their parameters."""
    return {
        GAINS[joint][field].name: value
        for joint, fields in gains.model_dump().items()
        for field, value in fields.items()
    }


def current_values(node: Node) -> dict[str, Any]:
    """The values of all changeable parameters."""
    return {parameter.name: node.get_parameter(parameter.name).value for parameter in CHANGEABLE}


def tuning(values: Mapping[str, Any]) -> Tuning:
    """The tuning that `values` by name give; `ConfigurationError` says which is wrong, and why."""
    gains = {
        joint: {field: one.check(values[one.name]) for field, one in fields.items()}
        for joint, fields in GAINS.items()
    }
    return Tuning(
        validate(gains, Gains, "parameters 'gains'").arrays,
        SATURATION.check(values[SATURATION.name]),
        np.array([one.check(values[one.name]) for one in TOLERANCES.values()]),
    )
