"""A diagnostic experiment: each joint in turn at several constant speeds both ways, with dwells.

At constant speed inertia is out of the picture: what is left of the force, gravity apart, is the
friction at that speed and position. Dwells show what joints and cylinders do at rest.
"""

from collections.abc import Sequence

import numpy as np

from crane_model.configuration import validate
from crane_model.errors import ConfigurationError, RangeError
from crane_model.machine import Machine
from crane_trajectory.excitation.limits import Margins, poses_per_joint
from crane_trajectory.motion.check import Clearance, TipRoom, trajectory_violations
from crane_trajectory.motion.periodic import SweepTrajectory

POSES, MOST_POSES = 5, 625  # per joint and in all, among which that of rest is chosen
FINE = 200  # positions of a sweep at which the room of the tip is looked at
CORNER = 0.5  # s
DECIMALS = 6


def design_sweeps(
    machine: Machine,
    joints: tuple[str, ...],
    clearance: Clearance,
    margins: Margins,
    shares: Sequence[float],
    dwell: float,
    name: str,
) -> SweepTrajectory:
    """Sweeps of `joints`, as wide as limits and room allow from one pose of the others.

    `shares` of the smaller velocity limit of a joint are its speeds, `dwell` [s] the rest at either
    end. Raises `ConfigurationError` if they last longer than a trajectory may, `RangeError` if a
    limit would be passed or no pose leaves the tip its room.
    """
    limits = [machine.limits[joint] for joint in joints]
    lowest, highest = np.array([(x.position_min, x.position_max) for x in limits]).T
    free = margins.position * (highest - lowest)
    lowest, highest = lowest + free, highest - free
    home, ends = _widest(_Clear(machine, joints, clearance, margins), lowest, highest)
    knots, positions = [0.0], [home]

    def go(column: int, target: float, speed: float) -> None:
        way = abs(target - positions[-1][column])
        if way > 0.0:
            knots.append(knots[-1] + max(way / speed, 2.0 * CORNER))
            positions.append(np.where(np.arange(len(home)) == column, target, positions[-1]))
        knots.append(knots[-1] + dwell)
        positions.append(positions[-1])

    for column, limit in enumerate(limits):
        top = min(limit.velocity_max, -limit.velocity_min) * (1.0 - margins.velocity)
        middle = top * float(np.median(shares))
        go(column, ends[column][0], middle)
        for share in shares:
            go(column, ends[column][1], top * share)
            go(column, ends[column][0], top * share)
        go(column, float(home[column]), middle)
    times = np.round(knots, DECIMALS).tolist()
    courses = zip(joints, np.round(positions, DECIMALS).T.tolist(), strict=True)
    content = {
        "kind": "sweep",
        "name": name,
        "period": times[-1],
        "corner": CORNER,
        "joints": {joint: {"time": times, "position": course} for joint, course in courses},
    }
    trajectory = validate(content, SweepTrajectory, f"sweeps '{name}'")
    found = trajectory_violations(machine, trajectory, clearance)
    if found:
        listed = "\n  ".join(map(str, found))
        raise RangeError(f"sweeps '{name}': lower the speeds, or raise the margins:\n  {listed}")
    return trajectory


class _Clear:
    """Whether the tip keeps its room, with a margin, where the machine stands."""

    def __init__(
        self, machine: Machine, joints: tuple[str, ...], clearance: Clearance, margins: Margins
    ):
        self._room, self._joints = TipRoom(machine), joints
        self._keep = clearance.kept + margins.room
        if not set(self._room.joints) <= set(joints):
            raise ConfigurationError(
                f"{machine.name}: the room of its tip depends on {', '.join(self._room.joints)}, "
                f"but the model has only {', '.join(joints)}; add the others to the model"
            )
        self.told = f"{clearance}: no pose within Table 2 keeps the boom tip clear by this and a "
        self.told += f"margin of {margins.room} m; lower the clearance or the margin"

    def at(self, positions: np.ndarray) -> np.ndarray:
        """(n, j) positions to (n,)."""
        clear: np.ndarray = np.all(self._room.at(self._joints, positions) >= self._keep, axis=1)
        return clear


def _widest(
    clear: _Clear, lowest: np.ndarray, highest: np.ndarray
) -> tuple[np.ndarray, list[tuple[float, float]]]:
    """The pose from which the narrowest sweep of a joint is widest, and the ends of the sweeps."""
    count = poses_per_joint(len(lowest), POSES, MOST_POSES)
    shares = (np.arange(count) + 0.5) / count
    grid = np.stack(np.meshgrid(*[shares] * len(lowest), indexing="ij"), axis=-1)
    best, chosen, ends = 0.0, lowest, []
    for pose in lowest + grid.reshape(-1, len(lowest)) * (highest - lowest):
        reach = [
            _reach(clear, pose, column, lowest[column], highest[column])
            for column in range(len(pose))
        ]
        width = min(
            (high - low) / span for (low, high), span in zip(reach, highest - lowest, strict=True)
        )
        if width > best:
            best, chosen, ends = width, pose, reach
    if not ends:
        raise RangeError(clear.told)
    return np.round(chosen, DECIMALS), ends


def _reach(
    clearing: _Clear, pose: np.ndarray, column: int, low: float, high: float
) -> tuple[float, float]:
    """How far joint `column` can go from the pose either way while the tip keeps its room."""
    positions = np.tile(pose, (FINE, 1))
    positions[:, column] = np.linspace(low, high, FINE)
    clear = clearing.at(positions)
    here = int(np.abs(positions[:, column] - pose[column]).argmin())
    if not clear[here]:
        return float(pose[column]), float(pose[column])
    blocked = np.flatnonzero(~clear)
    first = blocked[blocked < here].max(initial=-1) + 1
    last = blocked[blocked > here].min(initial=FINE) - 1
    return float(positions[first, column]), float(positions[last, column])
