"""Whole-trajectory check: Table 2, cylinder stroke, pump flow, tip clearance; its picture."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from crane_model.configuration import NonNegative, Schema, load
from crane_model.cylinders import lever_arm
from crane_model.errors import ConfigurationError, RangeError
from crane_model.kinematics import tip_jacobian, tip_position
from crane_model.machine import Machine
from crane_trajectory.motion.periodic import PeriodicTrajectory

if TYPE_CHECKING:
    from matplotlib.axes import Axes

GOLDEN = (np.sqrt(5.0) - 1.0) / 2.0
GOLDEN_STEPS = 30  # shrink a bracket by 5e-7, so a smooth maximum by the square of that
GRID_PER_PERIOD = 40  # samples per period of the highest harmonic; extremes are refined from these
LIMIT_TOLERANCE = 1e-9  # of a limit, for a reference that runs exactly along it
SMALL = 1e-9  # m, or sine of an angle
DIRECTION_DECIMALS = 12  # so that axes of the base's frame are exact
PICTURE_POINTS = 1000
LINE_COLOR, LIMIT_COLOR = "#1f4e79", "#c0392b"

PathFunction = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]
"""Times (m,) [s] to positions and velocities, each (m, j)."""


def maxima(
    function: Callable[[np.ndarray], np.ndarray], grid: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Largest value of each column of `function` over the span of `grid`, and where.

    `function` takes times (m,) and returns (m, k). Every local maximum of the samples is refined
    by golden-section search between its neighbours, so the grid need only be fine enough to
    separate the maxima. Returns times (k,) and values (k,).
    """
    samples = function(grid)
    wall = np.full((1, samples.shape[1]), -np.inf)
    rises = samples > np.vstack([wall, samples[:-1]])
    falls = samples >= np.vstack([samples[1:], wall])
    row, column = np.nonzero(rises & falls)
    pick = np.arange(len(row))
    left = grid[np.maximum(row - 1, 0)]
    right = grid[np.minimum(row + 1, len(grid) - 1)]
    for _ in range(GOLDEN_STEPS):
        width = GOLDEN * (right - left)
        inner_left, inner_right = right - width, left + width
        both = function(np.concatenate([inner_left, inner_right]))
        at_left, at_right = both.reshape(2, len(row), -1)[:, pick, column]
        higher_right = at_right > at_left
        left = np.where(higher_right, inner_left, left)
        right = np.where(higher_right, right, inner_right)
    middle = (left + right) / 2
    refined = function(middle)[pick, column]
    on_grid = samples[row, column] >= refined  # a maximum at either end of the span
    time = np.where(on_grid, grid[row], middle)
    value = np.where(on_grid, samples[row, column], refined)
    order = np.lexsort((value, column))  # the largest of each column comes last
    last = np.flatnonzero(np.diff(column[order], append=samples.shape[1]))
    return time[order][last], value[order][last]


class TipClearance:
    """Position of the tip relative to the pillar.

    The pillar is the axis of the first joint if that turns about the vertical, which then changes
    nothing; else the vertical through the base. Ahead is the direction of the tip with all joints
    in the middle of their ranges. The ground is the plane through the base.
    """

    def __init__(self, machine: Machine):
        self._machine = machine
        up = -machine.gravity_vector / machine.gravity
        first, frame = machine.joints[0], machine.base.matrix
        placed = frame @ first.before
        slewing = first.kind == "revolute" and (
            np.linalg.norm(np.cross(placed[:3, :3] @ first.direction, up)) < SMALL
        )
        self.joints = machine.joint_names[1:] if slewing else machine.joint_names
        """Those that move the tip with respect to the pillar."""
        self._foot = (placed if slewing else frame)[:3, 3]
        middle = machine.ranges(self.joints).middle[np.newaxis]
        ahead = tip_position(machine, self._all_joints(self.joints, middle))[0] - self._foot
        ahead -= (ahead @ up) * up
        if np.linalg.norm(ahead) < SMALL:  # upright: ahead is where the base's frame says
            ahead = frame[:3, 0] - (frame[:3, 0] @ up) * up
        self._directions = np.round([ahead / np.linalg.norm(ahead), up], DIRECTION_DECIMALS)

    def require(self, joints: Sequence[str], instead: str = "") -> None:
        """`ConfigurationError` unless `joints` are all that move the tip."""
        if not set(self.joints) <= set(joints):
            raise ConfigurationError(
                f"{self._machine.name}: the clearance of its tip depends on "
                f"{', '.join(self.joints)}, but the model has only {', '.join(joints)}; "
                f"add the others to the model{instead}"
            )

    def at(self, joints: Sequence[str], position: np.ndarray) -> np.ndarray:
        """(n, j) positions of `joints` to (n, 2): distance, positive ahead, and height [m]."""
        tip = tip_position(self._machine, self._all_joints(joints, position))
        return np.stack([(tip - self._foot) @ self._directions[0], tip @ self._directions[1]], 1)

    def slopes(self, joints: Sequence[str], position: np.ndarray) -> np.ndarray:
        """(n, 2, j): derivatives of both with respect to the positions (n, j) of `joints`."""
        jacobian = self._directions @ tip_jacobian(
            self._machine, self._all_joints(joints, position)
        )
        slopes: np.ndarray = jacobian[:, :, [self._machine.index(joint) for joint in joints]]
        slopes[:, :, [joint not in self.joints for joint in joints]] = 0.0
        return slopes

    def point(self, pose: np.ndarray, distance: float, height: float) -> np.ndarray:
        """(3,) in the base frame [m], in the upright plane in which the tip is at `pose` (j,)."""
        up, names = self._directions[1], self._machine.joint_names
        way = tip_position(self._machine, pose[np.newaxis])[0] - self._foot
        way -= (way @ up) * up
        ahead = way * np.sign(self.at(names, pose[np.newaxis])[0, 0])
        if (length := float(np.linalg.norm(ahead))) < SMALL:
            ahead, length = self._directions[0], 1.0
        point: np.ndarray = self._foot + distance / length * ahead
        return point + (height - point @ up) * up

    def _all_joints(self, joints: Sequence[str], position: np.ndarray) -> np.ndarray:
        q = np.zeros((len(position), len(self._machine.joint_names)))
        for joint in self.joints:
            q[:, self._machine.index(joint)] = position[:, joints.index(joint)]
        return q


class Clearance(Schema):
    """Clearance that the boom tip keeps, as `TipClearance` has it.

    Parameters
    ----------
    gripper_length
        How far the gripper hangs below the tip [m].
    ground_clearance, pillar_clearance
        Least distance of the gripper from the ground and of the tip from the pillar [m]; None if
        there is none to keep.
    """

    gripper_length: NonNegative
    ground_clearance: NonNegative | None
    pillar_clearance: NonNegative | None

    @property
    def lowest_tip(self) -> float:
        """Least height of the tip, from which the gripper hangs [m]."""
        return self.gripper_length + self._kept(self.ground_clearance)

    @property
    def kept(self) -> np.ndarray:
        """(2,): least distance of the tip from the pillar, and its least height [m]."""
        return np.array([self._kept(self.pillar_clearance), self.lowest_tip])

    @staticmethod
    def _kept(least: float | None) -> float:
        return -np.inf if least is None else least


def load_clearance(path: Path | str) -> Clearance:
    """Load the clearance of a YAML file.

    Parameters
    ----------
    path
        The file.

    Returns
    -------
    Clearance
        The clearance.

    Raises
    ------
    ConfigurationError
        The file cannot be read, or a value in it is wrong.
    """
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
    reference: PathFunction,
    grid: np.ndarray,
    clearance: Clearance,
) -> list[Violation]:
    """Every limit that `reference` passes within the span of `grid`, worst value each.

    The grid (n,) [s] must separate the extremes; they are refined between its points. Clearance is
    checked if all joints that move the tip to and fro are among `joints`.
    """
    found: list[Violation] = []
    fits = set()
    for joint, (lowest, highest, slowest, fastest) in zip(
        joints, _joint_extremes(reference, grid), strict=True
    ):
        limits, unit = machine.limits[joint], machine.units[joint]
        position = [
            *_above(joint, "position", highest, limits.position_max, unit),
            *_below(joint, "position", lowest, limits.position_min, unit),
        ]
        found += position
        found += _above(joint, "velocity", fastest, limits.velocity_max, f"{unit}/s")
        found += _below(joint, "velocity", slowest, limits.velocity_min, f"{unit}/s")
        if joint in machine.cylinders:
            found += _stroke(machine, joint, (lowest, highest))
        if not position:
            fits.add(joint)
    if fits == set(joints):  # elsewhere lever arms and tip have no meaning
        if machine.supply:
            found += _flow(machine, joints, reference, grid)
        tip_clearance = TipClearance(machine)
        if set(tip_clearance.joints) <= fits:
            found += _clearance_violations(tip_clearance, joints, reference, grid, clearance)
    return found


def check_joints(machine: Machine, trajectory: PeriodicTrajectory) -> None:
    """`RangeError` unless the machine has every joint that the trajectory moves."""
    if unknown := [joint for joint in trajectory.joint_names if joint not in machine.joint_names]:
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


def _joint_extremes(reference: PathFunction, grid: np.ndarray) -> list[list[Extreme]]:
    """Lowest and highest position, slowest and fastest velocity of each joint."""

    def both_sides(time: np.ndarray) -> np.ndarray:
        position, velocity = reference(time)
        return np.hstack([-position, position, -velocity, velocity])

    times, values = (array.reshape(4, -1).T for array in maxima(both_sides, grid))
    values = values * (-1.0, 1.0, -1.0, 1.0)
    return [
        [Extreme(*pair) for pair in zip(time, value, strict=True)]
        for time, value in zip(times.tolist(), values.tolist(), strict=True)
    ]


def _above(joint: str, quantity: str, extreme: Extreme, limit: float, unit: str) -> list[Violation]:
    if extreme.value <= limit + LIMIT_TOLERANCE * abs(limit):
        return []
    return [Violation(joint, quantity, extreme.time, limit, extreme.value, unit)]


def _below(joint: str, quantity: str, extreme: Extreme, limit: float, unit: str) -> list[Violation]:
    if extreme.value >= limit - LIMIT_TOLERANCE * abs(limit):
        return []
    return [Violation(joint, quantity, extreme.time, limit, extreme.value, unit)]


def _stroke(machine: Machine, joint: str, ends: tuple[Extreme, Extreme]) -> list[Violation]:
    """The length is monotone in q, so its extremes are at those of the position."""
    cylinder, quantity = machine.cylinders[joint], "cylinder length"
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
        if joint not in machine.cylinders:
            continue
        cylinder = machine.cylinders[joint]
        speed = lever_arm(machine, joint, position[:, i]) * velocity[:, i]
        flow += np.where(speed > 0.0, cylinder.area_a, -cylinder.area_b) * speed
    return flow


def _flow(
    machine: Machine, joints: Sequence[str], reference: PathFunction, grid: np.ndarray
) -> list[Violation]:
    def flow(time: np.ndarray) -> np.ndarray:
        return pump_flow(machine, joints, *reference(time))[:, None]

    time, value = maxima(flow, grid)
    largest = Extreme(float(time[0]), float(value[0]))
    return _above("all cylinders", "pump flow", largest, machine.hydraulics.pump_flow, "m3/s")


def _clearance_violations(
    tip_clearance: TipClearance,
    joints: Sequence[str],
    reference: PathFunction,
    grid: np.ndarray,
    clearance: Clearance,
) -> list[Violation]:
    def nearness(time: np.ndarray) -> np.ndarray:
        return -tip_clearance.at(joints, reference(time)[0])

    times, values = maxima(nearness, grid)
    near, low = map(Extreme, times.tolist(), (-values).tolist())
    distance, height = clearance.kept.tolist()
    return [
        *_below("boom tip", "distance from pillar", near, distance, "m"),
        *_below("boom tip", "height", low, height, "m"),
    ]


def draw(
    path: Path, machine: Machine, trajectory: PeriodicTrajectory, clearance: Clearance
) -> None:
    """Draw one period like Fig. 8, limits dashed: positions and velocities of the joints that it
    moves, pump flow, and the clearance of the tip. The suffix names the format (.png, .svg, .pdf).
    """
    from matplotlib.figure import Figure  # a second to import

    time = np.linspace(0.0, trajectory.period, PICTURE_POINTS)
    motion = trajectory.evaluate(time)
    joints = trajectory.joint_names
    columns = max(len(joints), 3)
    figure = Figure(figsize=(11.0 / 3.0 * columns, 7.5), layout="constrained")
    figure.suptitle(f"{trajectory.name}: {trajectory.period:.4g} s, limits dashed")
    axes = figure.subplots(3, columns, sharex=True)
    for i, joint in enumerate(joints):
        limits, unit, name = machine.limits[joint], machine.units[joint], joint.replace("_", " ")
        positions = limits.position_min, limits.position_max
        velocities = limits.velocity_min, limits.velocity_max
        _panel(axes[0, i], time, motion.position[:, i], positions, f"{name} [{unit}]")
        _panel(axes[1, i], time, motion.velocity[:, i], velocities, f"{name}, velocity [{unit}/s]")
    if machine.supply:
        flow = pump_flow(machine, joints, motion.position, motion.velocity)
        litres = 60e3 * flow, (60e3 * machine.supply.pump_flow,)
        _panel(axes[2, 0], time, *litres, "pump flow, all cylinders [l/min]")
    tip_clearance = TipClearance(machine)
    if set(tip_clearance.joints) <= set(joints):
        distance, height = tip_clearance.at(joints, motion.position).T
        nearest, lowest = clearance.kept.tolist()
        _panel(axes[2, 1], time, distance, (nearest,), "tip from pillar [m]")
        _panel(axes[2, 2], time, height, (lowest,), "tip above ground [m]")
    for panel in axes.ravel():
        if not panel.has_data():
            panel.remove()
    for below in axes[2]:
        below.set_xlabel("time [s]")
    figure.savefig(path, dpi=120)


def _panel(
    axes: "Axes", time: np.ndarray, values: np.ndarray, limits: tuple[float, ...], title: str
) -> None:
    axes.plot(time, values, color=LINE_COLOR, linewidth=1.5)
    for limit in filter(np.isfinite, limits):
        axes.axhline(limit, color=LIMIT_COLOR, linestyle="--", linewidth=1.0)
    axes.set_title(title, fontsize="medium", loc="left")
    axes.margins(x=0.0, y=0.1)
    axes.grid(alpha=0.3)
