"""What is inconsistent in a machine file, though each of its values is possible by itself."""

import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from crane_model.actuators import CylinderActuator, HydraulicActuator
from crane_model.array import Array
from crane_model.kinematics import tip_position
from crane_model.machine import Machine

# What the actuators of a machine do over the ranges of their joints.

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


SMALLEST_REACH, LARGEST_REACH = 0.3, 60.0  # m
SMALLEST_AREA, LARGEST_AREA = 2e-5, 0.15  # m2, pistons of 5 and 440 mm
SMALLEST_PUMP, LARGEST_PUMP = 1e-6, 0.2  # m3/s, 0.06 and 12,000 l/min
LOWEST_SUPPLY, HIGHEST_SUPPLY = 2e6, 5e7  # Pa
WIDEST_TURN = 6.0 * math.pi  # rad
FASTEST_JOINT = 12.0  # rad/s or m/s
PORT = 0.05  # m, of a cylinder that its ends take from the stroke, at least
SPARE_STROKE = 0.5  # share of the stroke that limits may leave unused


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
    limits = [machine.limits[joint] for joint in machine.joint_names]
    low = np.array([one.position_min for one in limits])
    high = np.array([one.position_max for one in limits])
    return np.stack([low, (low + high) / 2.0, high])


def reached(machine: Machine, count: int = 20_000) -> np.ndarray:
    """(count, 3) places of the tip at random within the limits [m]."""
    low, _, high = poses(machine)
    q = np.random.default_rng(0).uniform(low, high, (count, len(low)))
    return tip_position(machine, q)


def _of_units(machine: Machine) -> Iterator[str]:
    reach = float(np.linalg.norm(reached(machine, 2000), axis=1).max())
    if not SMALLEST_REACH < reach < LARGEST_REACH:
        yield f"reach: {reach:.3g} m from the base; are lengths in m?"
    for joint, limits in machine.limits.items():
        turns, span = machine.units[joint] == "rad", limits.position_max - limits.position_min
        if turns and span > WIDEST_TURN:
            yield f"joint '{joint}': limits span {span:.3g} rad; are they in degrees?"
        if max(-limits.velocity_min, limits.velocity_max) > FASTEST_JOINT:
            unit = machine.units[joint]
            yield (
                f"joint '{joint}': velocity up to {limits.velocity_max:.3g} {unit}/s; is it in "
                f"{'degrees' if turns else 'mm'}/s?"
            )
    for joint, one in machine.cylinders.items():
        if isinstance(one, CylinderActuator):
            for key, area in (("area_a", one.area_a_of_one), ("area_b", one.area_b_of_one)):
                if not SMALLEST_AREA < area < LARGEST_AREA:
                    yield f"joint '{joint}': {key} is {area:.3g} m2; is it in m2?"


def _of_supply(machine: Machine) -> Iterator[str]:
    if (supply := machine.supply) is None:
        return
    if not LOWEST_SUPPLY < supply.supply_pressure < HIGHEST_SUPPLY:
        yield f"hydraulics: supply_pressure is {supply.supply_pressure:.3g} Pa; is it in Pa?"
    if not SMALLEST_PUMP < supply.pump_flow < LARGEST_PUMP:
        yield f"hydraulics: pump_flow is {supply.pump_flow:.3g} m3/s; is it in m3/s?"
    if not supply.tank_pressure < supply.supply_pressure <= supply.relief_pressure:
        yield (
            "hydraulics: tank_pressure < supply_pressure <= relief_pressure must hold, got "
            f"{supply.tank_pressure:.3g}, {supply.supply_pressure:.3g}, "
            f"{supply.relief_pressure:.3g} Pa"
        )


def _of_cylinder(machine: Machine, joint: str) -> Iterator[str]:
    one, limits = machine.cylinders[joint], machine.limits[joint]
    grid = np.linspace(limits.position_min, limits.position_max, POINTS)
    x, lever, _ = machine.cylinder(joint, grid).T
    speed = np.outer([limits.velocity_min, limits.velocity_max], lever)
    flow = float(np.where(speed > 0.0, speed * one.area_a, -speed * one.area_b).max())
    if flow > machine.hydraulics.pump_flow:
        yield (
            f"joint '{joint}': its velocities need {_litres(flow)} l/min, the pump delivers "
            f"{_litres(machine.hydraulics.pump_flow)}; check velocities, areas and pump_flow"
        )
    if not isinstance(one, CylinderActuator):
        return
    if one.area_b > one.area_a:
        yield f"joint '{joint}': area_b, of the rod's side, is larger than area_a; exchanged?"
    stroke, used = one.length_max - one.length_min, float(np.ptp(x))
    if one.bounded_by_pins and stroke > one.length_min - PORT:
        yield (
            f"joint '{joint}': a cylinder of {one.length_min:.3g} m from pin to pin cannot have a "
            f"stroke of {stroke:.3g} m; check length_min, length_max and the linkage"
        )
    if used < SPARE_STROKE * stroke:
        yield (
            f"joint '{joint}': its limits use {used:.3g} m of a stroke of {stroke:.3g} m; check "
            "the linkage, length_min and length_max"
        )


def _of_joints(machine: Machine) -> Iterator[str]:
    for joint, one in machine.actuators.items():
        if not one.drives:
            yield f"joint '{joint}': nothing drives it; is its actuator not entered yet?"
        if isinstance(one, HydraulicActuator) and not one.pressure_sensors:
            yield f"joint '{joint}': no pressure sensors, so that its force is not measured"


def _litres(flow: float) -> str:
    return f"{flow * 6e4:.3g}"
