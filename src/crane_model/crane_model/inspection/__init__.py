"""Travels of a machine's actuators, inconsistencies in its file, and positions of its pins.

The command `machine` and the pictures of machines use this.
"""

import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from crane_model.actuators import CylinderActuator, HydraulicActuator
from crane_model.array import Array
from crane_model.joint import MachineJoint
from crane_model.kinematics import link_transforms, tip_position
from crane_model.machine import Machine

GRID_POINTS = 401


class Travel(NamedTuple):
    """One joint: x of its actuator, lever arm dx/dq, and largest forces on the joint both ways."""

    joint: str
    x: Array  # (2,) least and largest [m, rad]
    lever: Array  # (2,) of least and largest size [m/rad, 1]
    up: Array | None  # (2,) least and largest [N m, N] at the supply pressure; None if not known
    down: Array | None  # (2,) the same, in the negative direction


def travels(machine: Machine) -> Iterator[Travel]:
    """Travels of all joints."""
    for joint in machine.joint_names:
        limits, actuator = machine.limits[joint], machine.actuators[joint]
        grid = np.linspace(limits.position_min, limits.position_max, GRID_POINTS)
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
    for travel in travels(machine):
        limits, unit = machine.limits[travel.joint], machine.units[travel.joint]
        force = "N m" if unit == "rad" else "N"
        actuator = machine.actuators[travel.joint]
        turns = actuator.has_rotor or (not actuator.drives and unit == "rad")
        length = "rad" if turns else "m"
        strength = "not known"
        if travel.up is not None and travel.down is not None:
            strength = f"{_to(travel.up)}; {_to(travel.down)} {force}"
        lines.append(
            f"{travel.joint:<14}{actuator.type:<20}"
            f"{_to(np.array([limits.position_min, limits.position_max])) + ' ' + unit:<20}"
            f"{_to(travel.x) + ' ' + length:<22}{_to(travel.lever):<20}{strength}"
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


MIN_REACH_M, MAX_REACH_M = 0.3, 60.0  # m
MIN_AREA_M2, MAX_AREA_M2 = 2e-5, 0.15  # m2, pistons of 5 and 440 mm
MIN_PUMP_M3_S, MAX_PUMP_M3_S = 1e-6, 0.2  # m3/s, 0.06 and 12,000 l/min
MIN_SUPPLY_PA, MAX_SUPPLY_PA = 2e6, 5e7  # Pa
MAX_TURN_RAD = 6.0 * math.pi
MAX_JOINT_SPEED = 12.0  # rad/s or m/s
MIN_PORT_M = 0.05  # of a cylinder that its ends take from the stroke, at least
MAX_SPARE_STROKE = 0.5  # share of the stroke that limits may leave unused


def findings(machine: Machine) -> list[str]:
    """One line each, with what to check; empty where nothing is inconsistent."""
    return [
        *_of_units(machine),
        *_of_supply(machine),
        *(line for joint in machine.cylinders for line in _of_cylinder(machine, joint)),
        *_of_joints(machine),
    ]


def poses(machine: Machine) -> np.ndarray:
    """(3, j): all joints at their lower limits, in the middle, and at their upper limits."""
    low, high, middle, *_ = machine.ranges()
    return np.stack([low, middle, high])


def reached(machine: Machine, count: int = 20_000) -> np.ndarray:
    """(count, 3) places of the tip at random within the limits [m]."""
    low, _, high = poses(machine)
    q = np.random.default_rng(0).uniform(low, high, (count, len(low)))
    return tip_position(machine, q)


def _of_units(machine: Machine) -> Iterator[str]:
    reach = float(np.linalg.norm(reached(machine, 2000), axis=1).max())
    if not MIN_REACH_M < reach < MAX_REACH_M:
        yield f"reach: {reach:.3g} m from the base; are lengths in m?"
    for joint, limits in machine.limits.items():
        turns, span = machine.units[joint] == "rad", limits.position_max - limits.position_min
        if turns and span > MAX_TURN_RAD:
            yield f"joint '{joint}': limits span {span:.3g} rad; are they in degrees?"
        if limits.top_speed > MAX_JOINT_SPEED:
            unit = machine.units[joint]
            yield (
                f"joint '{joint}': velocity up to {limits.velocity_max:.3g} {unit}/s; is it in "
                f"{'degrees' if turns else 'mm'}/s?"
            )
    for joint, cylinder in machine.cylinders.items():
        if isinstance(cylinder, CylinderActuator):
            for key, area in (
                ("area_a", cylinder.area_a_of_one),
                ("area_b", cylinder.area_b_of_one),
            ):
                if not MIN_AREA_M2 < area < MAX_AREA_M2:
                    yield f"joint '{joint}': {key} is {area:.3g} m2; is it in m2?"


def _of_supply(machine: Machine) -> Iterator[str]:
    if (supply := machine.supply) is None:
        return
    if not MIN_SUPPLY_PA < supply.supply_pressure < MAX_SUPPLY_PA:
        yield f"hydraulics: supply_pressure is {supply.supply_pressure:.3g} Pa; is it in Pa?"
    if not MIN_PUMP_M3_S < supply.pump_flow < MAX_PUMP_M3_S:
        yield f"hydraulics: pump_flow is {supply.pump_flow:.3g} m3/s; is it in m3/s?"
    if not supply.tank_pressure < supply.supply_pressure <= supply.relief_pressure:
        yield (
            "hydraulics: tank_pressure < supply_pressure <= relief_pressure must hold, got "
            f"{supply.tank_pressure:.3g}, {supply.supply_pressure:.3g}, "
            f"{supply.relief_pressure:.3g} Pa"
        )


def _of_cylinder(machine: Machine, joint: str) -> Iterator[str]:
    cylinder, limits = machine.cylinders[joint], machine.limits[joint]
    grid = np.linspace(limits.position_min, limits.position_max, GRID_POINTS)
    x, lever, _ = machine.cylinder(joint, grid).T
    speed = np.outer([limits.velocity_min, limits.velocity_max], lever)
    flow = float(np.where(speed > 0.0, speed * cylinder.area_a, -speed * cylinder.area_b).max())
    if flow > machine.hydraulics.pump_flow:
        yield (
            f"joint '{joint}': its velocities need {_litres(flow)} l/min, the pump delivers "
            f"{_litres(machine.hydraulics.pump_flow)}; check velocities, areas and pump_flow"
        )
    if not isinstance(cylinder, CylinderActuator):
        return
    if cylinder.area_b > cylinder.area_a:
        yield f"joint '{joint}': area_b, of the rod's side, is larger than area_a; exchanged?"
    stroke, used = cylinder.length_max - cylinder.length_min, float(np.ptp(x))
    if cylinder.bounded_by_pins and stroke > cylinder.length_min - MIN_PORT_M:
        yield (
            f"joint '{joint}': a cylinder of {cylinder.length_min:.3g} m from pin to pin cannot "
            f"have a stroke of {stroke:.3g} m; check length_min, length_max and the linkage"
        )
    if used < MAX_SPARE_STROKE * stroke:
        yield (
            f"joint '{joint}': its limits use {used:.3g} m of a stroke of {stroke:.3g} m; check "
            "the linkage, length_min and length_max"
        )


def _of_joints(machine: Machine) -> Iterator[str]:
    for joint, actuator in machine.actuators.items():
        if not actuator.drives:
            yield f"joint '{joint}': nothing drives it; is its actuator not entered yet?"
        if isinstance(actuator, HydraulicActuator) and not actuator.pressure_sensors:
            yield f"joint '{joint}': no pressure sensors, so that its force is not measured"


def _litres(flow: float) -> str:
    return f"{flow * 6e4:.3g}"


# Positions of joints and actuators of a machine, for pictures.


class PlacedBar(NamedTuple):
    """A cylinder, or a link, between two pins (3,) in the base's frame [m]."""

    joint: str
    begin: Array
    end: Array
    is_cylinder: bool


def placed_joints(machine: Machine, q: Array) -> Array:
    """(m, 4, 4) of each joint of the chain before it moves, in the base's frame, at q (j,)."""
    links = link_transforms(machine, q)[0]
    before = np.concatenate([machine.base.matrix[None], links[:-1]])
    placed: Array = before @ np.array([joint.before for joint in machine.joints])
    return placed


def placed_bars(machine: Machine, q: Array) -> list[PlacedBar]:
    """Parts of the actuators at q (j,), from the base to the tip."""
    return [
        PlacedBar(
            joint.name,
            _across(joint, frame, bar.begin),
            _across(joint, frame, bar.end),
            bar.is_cylinder,
        )
        for joint, frame in zip(machine.joints, placed_joints(machine, q), strict=True)
        if joint.actuator is not None
        for bar in joint.actuator.bars(q[machine.index(joint.name)])
    ]


def _across(joint: MachineJoint, frame: Array, pin: Array) -> Array:
    """A point (2,) of the plane across the joint's axis in the base's frame (3,)."""
    axis = joint.direction
    x = np.eye(3)[0] - axis[0] * axis
    if np.linalg.norm(x) < 1e-6:  # the joint turns about x: then it is y
        x = np.eye(3)[1] - axis[1] * axis
    x = x / np.linalg.norm(x)
    within = pin[0] * x + pin[1] * np.cross(axis, x)
    place: Array = frame[:3, :3] @ within + frame[:3, 3]
    return place
