"""Whole-trajectory check: Table 2, cylinder stroke, pump flow, and room for the boom tip."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from crane_model.configuration import NonNegative, Schema, load
from crane_model.cylinders import lever_arm
from crane_model.errors import RangeError
from crane_model.kinematics import tip_position
from crane_model.machine import PLANAR_JOINTS, Machine
from crane_trajectory.motion.extremes import maxima
from crane_trajectory.motion.periodic import PeriodicTrajectory

GRID_PER_PERIOD = 40  # samples per period of the highest harmonic; extremes are refined from these
TOLERANCE = 1e-9  # of a limit, for a reference that runs exactly along it

Reference = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]
"""Times (m,) [s] to positions and velocities, each (m, j)."""


class Clearance(Schema):
    """Room that the boom tip keeps [m]; the ground is z = 0 and the pillar the z axis."""

    gripper_length: NonNegative
    ground_clearance: NonNegative
    pillar_clearance: NonNegative

    @property
    def lowest_tip(self) -> float:
        """Least height of the tip, from which the gripper hangs [m]."""
        return self.gripper_length + self.ground_clearance


def load_clearance(path: Path | str) -> Clearance:
    """The clearance in `path`; `ConfigurationError` if wrong."""
    return load(path, Clearance)


@dataclass(frozen=True)
class Violation:
    """The worst passing of one limit: value and limit in `unit`, at `time` [s]."""

    joint: str
    quantity: str
    time: float
    limit: float
    value: float
    unit: str

    def __str__(self) -> str:
        if math.isnan(self.value):
            return f"{self.joint}: the linkage cannot be assembled at t = {self.time:.3f} s"
        side = "above" if self.value > self.limit else "below"
        return (
            f"{self.joint}: {self.quantity} {self.value:.6g} {self.unit} at t = {self.time:.3f} s "
            f"is {side} the limit {self.limit:.6g} {self.unit}"
        )


def violations(
    machine: Machine,
    joints: Sequence[str],
    reference: Reference,
    grid: np.ndarray,
    clearance: Clearance,
) -> list[Violation]:
    """Every limit that `reference` passes within the span of `grid`, worst value each.

    The grid (n,) [s] must separate the extremes; they are refined between its points. Clearance is
    checked where all planar joints are among `joints`.
    """
    found: list[Violation] = []
    fits = set()
    for joint, extremes in zip(joints, _joint_extremes(reference, grid), strict=True):
        limits, unit = machine.limits[joint], machine.units[joint]
        position = [
            *_above(joint, "position", extremes.highest, limits.position_max, unit),
            *_below(joint, "position", extremes.lowest, limits.position_min, unit),
        ]
        found += [
            *position,
            *_above(joint, "velocity", extremes.fastest, limits.velocity_max, f"{unit}/s"),
            *_below(joint, "velocity", extremes.slowest, limits.velocity_min, f"{unit}/s"),
            *_stroke(machine, joint, extremes),
        ]
        if not position:
            fits.add(joint)
    if fits == set(joints):  # elsewhere lever arms and tip have no meaning
        found += _flow(machine, joints, reference, grid)
        if set(PLANAR_JOINTS) <= fits:
            found += _room(machine, joints, reference, grid, clearance)
    return found


def check_joints(machine: Machine, trajectory: PeriodicTrajectory) -> None:
    """`RangeError` unless the machine has every joint that the trajectory moves."""
    if unknown := [one for one in trajectory.joint_names if one not in machine.joint_names]:
        raise RangeError(
            f"trajectory '{trajectory.name}': no joint {', '.join(unknown)}; {machine.name} has "
            f"the joints {', '.join(machine.joint_names)}"
        )


def trajectory_grid(trajectory: PeriodicTrajectory) -> np.ndarray:
    """Times (n,) over one period, fine enough for `violations`."""
    return np.linspace(0.0, trajectory.period, GRID_PER_PERIOD * trajectory.harmonics + 1)


def trajectory_violations(
    machine: Machine, trajectory: PeriodicTrajectory, clearance: Clearance
) -> list[Violation]:
    """`violations` of one period of a trajectory by itself."""

    def reference(time: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        samples = trajectory.evaluate(time)
        return samples.position, samples.velocity

    check_joints(machine, trajectory)
    return violations(
        machine, trajectory.joint_names, reference, trajectory_grid(trajectory), clearance
    )


def refuse(found: Sequence[Violation], name: str, remedy: str) -> None:
    """Raise `RangeError` that lists all of `found`; nothing if there are none."""
    if found:
        listed = "\n  ".join(str(violation) for violation in found)
        raise RangeError(f"{name}: leaves what the crane can do; {remedy}:\n  {listed}")


class Extreme(NamedTuple):
    """An extreme value and when it is taken [s]."""

    time: float
    value: float


class JointExtremes(NamedTuple):
    """Lowest and highest position, slowest and fastest velocity of one joint."""

    lowest: Extreme
    highest: Extreme
    slowest: Extreme
    fastest: Extreme


def _joint_extremes(reference: Reference, grid: np.ndarray) -> list[JointExtremes]:
    def both_sides(time: np.ndarray) -> np.ndarray:
        position, velocity = reference(time)
        return np.hstack([-position, position, -velocity, velocity])

    times, values = (array.reshape(4, -1).T.tolist() for array in maxima(both_sides, grid))
    return [
        JointExtremes(
            Extreme(time[0], -value[0]),
            Extreme(time[1], value[1]),
            Extreme(time[2], -value[2]),
            Extreme(time[3], value[3]),
        )
        for time, value in zip(times, values, strict=True)
    ]


def _above(joint: str, quantity: str, extreme: Extreme, limit: float, unit: str) -> list[Violation]:
    if extreme.value <= limit + TOLERANCE * abs(limit):
        return []
    return [Violation(joint, quantity, extreme.time, limit, extreme.value, unit)]


def _below(joint: str, quantity: str, extreme: Extreme, limit: float, unit: str) -> list[Violation]:
    if extreme.value >= limit - TOLERANCE * abs(limit):
        return []
    return [Violation(joint, quantity, extreme.time, limit, extreme.value, unit)]


def _stroke(machine: Machine, joint: str, extremes: JointExtremes) -> list[Violation]:
    """The length is monotone in q, so its extremes are at those of the position."""
    cylinder, quantity = machine.cylinders[joint], "cylinder length"
    ends = (extremes.lowest, extremes.highest)
    lengths = machine.cylinder(joint, np.array([end.value for end in ends]))[:, 0]
    found = []
    for end, value in zip(ends, lengths.tolist(), strict=True):
        length = Extreme(end.time, value)
        if math.isnan(value):
            found.append(Violation(joint, quantity, end.time, cylinder.length_max, value, "m"))
        else:
            found += _above(joint, quantity, length, cylinder.length_max, "m")
            found += _below(joint, quantity, length, cylinder.length_min, "m")
    return found


def pump_flow(
    machine: Machine, joints: Sequence[str], position: np.ndarray, velocity: np.ndarray
) -> np.ndarray:
    """Flow [m3/s] into all cylinders at once, (n,): speed times area of the chamber that fills."""
    flow = np.zeros(len(position))
    for i, joint in enumerate(joints):
        cylinder = machine.cylinders[joint]
        speed = lever_arm(machine, joint, position[:, i]) * velocity[:, i]
        flow += np.where(speed > 0.0, cylinder.area_a, -cylinder.area_b) * speed
    return flow


def _flow(
    machine: Machine, joints: Sequence[str], reference: Reference, grid: np.ndarray
) -> list[Violation]:
    def flow(time: np.ndarray) -> np.ndarray:
        return pump_flow(machine, joints, *reference(time))[:, None]

    time, value = maxima(flow, grid)
    largest = Extreme(float(time[0]), float(value[0]))
    return _above("all cylinders", "pump flow", largest, machine.hydraulics.pump_flow, "m3/s")


def tip_room(machine: Machine, joints: Sequence[str], position: np.ndarray) -> np.ndarray:
    """(n, 2): distance of the tip from the pillar's axis, positive on the side that the booms
    point to, and height of the tip above the ground [m]. Does not depend on the slew angle."""
    q = np.zeros((len(position), len(machine.joint_names)))
    for joint in PLANAR_JOINTS:
        q[:, machine.index(joint)] = position[:, joints.index(joint)]
    return tip_position(machine, q)[:, [0, 2]]


def _room(
    machine: Machine,
    joints: Sequence[str],
    reference: Reference,
    grid: np.ndarray,
    clearance: Clearance,
) -> list[Violation]:
    def nearness(time: np.ndarray) -> np.ndarray:
        return -tip_room(machine, joints, reference(time)[0])

    times, values = maxima(nearness, grid)
    near, low = map(Extreme, times.tolist(), (-values).tolist())
    return [
        *_below("boom tip", "distance from pillar", near, clearance.pillar_clearance, "m"),
        *_below("boom tip", "height", low, clearance.lowest_tip, "m"),
    ]
