"""What the actuators of a machine do over the ranges of their joints."""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from crane_model.actuators import HydraulicActuator
from crane_model.array import Array
from crane_model.machine import Machine

POINTS = 401


class Travel(NamedTuple):
    """One joint: x of its actuator, lever arm dx/dq, and largest forces on the joint both ways."""

    joint: str
    x: Array  # (2,) least and largest [m, rad]
    lever: Array  # (2,) of least and largest size [m/rad, 1]
    up: Array | None  # (2,) least and largest [N m, N] at the supply pressure; None if not known
    down: Array | None  # (2,) the same, in the negative direction


def travels(machine: Machine) -> Iterator[Travel]:
    """Of all joints."""
    for joint in machine.joint_names:
        limits, actuator = machine.limits[joint], machine.actuators[joint]
        grid = np.linspace(limits.position_min, limits.position_max, POINTS)
        x, lever, _ = machine.cylinder(joint, grid).T
        up = down = None
        if isinstance(actuator, HydraulicActuator):
            pressure = machine.hydraulics.supply_pressure
            pushed, pulled = pressure * actuator.area_a, -pressure * actuator.area_b
            forces = np.sort([lever * pushed, lever * pulled], axis=0)
            up, down = _range(forces[1]), _range(forces[0])
        elif (torque := getattr(actuator, "largest_torque", None)) is not None:
            up = _range(np.abs(lever) * torque)
            down = -up
        yield Travel(joint, _range(x), _range(lever), up, down)


def table(machine: Machine) -> str:
    """The same as text, a line a joint."""
    lines = [
        f"{'joint':<14}{'actuator':<20}{'range':<20}{'x of the actuator':<22}{'lever arm':<20}"
        "largest force up; down"
    ]
    for one in travels(machine):
        limits, unit = machine.limits[one.joint], machine.units[one.joint]
        force = "N m" if unit == "rad" else "N"
        actuator = machine.actuators[one.joint]
        turns = actuator.has_rotor or (not actuator.drives and unit == "rad")
        length = "rad" if turns else "m"
        strength = "not known"
        if one.up is not None and one.down is not None:
            strength = f"{_to(one.up)}; {_to(one.down)} {force}"
        lines.append(
            f"{one.joint:<14}{actuator.type:<20}"
            f"{_to(np.array([limits.position_min, limits.position_max])) + ' ' + unit:<20}"
            f"{_to(one.x) + ' ' + length:<22}{_to(one.lever):<20}{strength}"
        )
    return "\n".join(lines)


def _range(values: Array) -> Array:
    """The values (2,) of least and largest size."""
    order = np.argsort(np.abs(values)) if np.ptp(np.sign(values)) == 0 else np.argsort(values)
    ends: Array = values[order[[0, -1]]]
    return ends


def _to(ends: Array) -> str:
    low, high = ends
    return f"{low:.4g}" if low == high else f"{low:.4g} to {high:.4g}"
