"""Motions of straight legs: a diagnostic experiment of sweeps, and random candidates.

A diagnostic experiment moves each joint in turn at several constant speeds both ways, with dwells.
At constant speed inertia is out of the picture: what is left of the force, gravity apart, is the
friction at that speed and position. Dwells show what joints and cylinders do at rest.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from crane_model.configuration import validate
from crane_model.errors import ConfigurationError, RangeError
from crane_model.machine import Machine
from crane_trajectory.excitation.limits import Margins, poses_per_joint
from crane_trajectory.excitation.search import DECIMALS, ExcitationProblem
from crane_trajectory.motion.check import Clearance, TipClearance, refuse, trajectory_violations
from crane_trajectory.motion.periodic import FourierTrajectory, JointCourse, SweepTrajectory

CORNER = 0.5  # s
REST_POSES, MOST_REST_POSES = 5, 625  # per joint and in all, among which that of rest is chosen
CLEARANCE_POINTS = 200  # positions of a sweep at which the clearance of the tip is looked at

SERIES_SHARES = (1.0, 0.97, 0.9, 0.8)  # of a series, tried in turn until it is within the limits
SERIES_VARIATION = 0.25  # of a series, rms over that of its waves

SPEEDS = (0.03, 0.95)  # of the limit, drawn evenly in ratios
ALONE, AT_AN_END, DWELLS = 0.6, 0.4, 0.3  # how often one joint moves alone, to an end, and dwells
DWELL = (0.5, 3.0)  # s
LARGEST_FACTOR = 1.5  # of the period: with its way back, and varied
LONGEST_LEG = 0.25  # of the period, so that there are several legs
POSE_ATTEMPTS = 200  # to find a pose that leaves the tip its clearance
SLOWER = (1.0, 1.3, 1.7)  # times as long, where the pump does not suffice
KNOT_SHIFT, LEG_STRETCH = 0.15, 0.4  # of the range, and of the log of the time of a leg


class ClearPoses:
    """Test whether the tip keeps its clearance, with a margin, at positions (j,) of some joints."""

    def __init__(
        self, machine: Machine, joints: tuple[str, ...], clearance: Clearance, margins: Margins
    ):
        self._tip_clearance, self._joints = TipClearance(machine), joints
        self._keep = clearance.kept + margins.clearance
        self.known = set(self._tip_clearance.joints) <= set(joints)
        self.remedy = (
            f"within the joint limits keeps the boom tip clear by this and a margin of "
            f"{margins.clearance} m; lower the clearance or the margin"
        )

    def at(self, positions: np.ndarray) -> np.ndarray:
        """(n, j) positions to (n,)."""
        clear: np.ndarray = np.all(
            self._tip_clearance.at(self._joints, positions) >= self._keep, axis=1
        )
        return clear


def design_sweeps(
    machine: Machine,
    joints: tuple[str, ...],
    clearance: Clearance,
    margins: Margins,
    shares: Sequence[float],
    dwell: float,
    name: str,
) -> SweepTrajectory:
    """Sweeps of `joints`, as wide as limits and clearance allow from one pose of the others.

    `shares` of the smaller velocity limit of a joint are its speeds, `dwell` [s] the rest at either
    end. Raises `ConfigurationError` if they last longer than a trajectory may, `RangeError` if a
    limit would be passed or no pose leaves the tip its clearance.
    """
    TipClearance(machine).require(joints)
    clear = ClearPoses(machine, joints, clearance, margins)
    home, ends = _widest(clear, *margins.positions(machine, joints))
    if not ends:
        raise RangeError(f"{clearance}: no pose {clear.remedy}")
    knots, positions = [0.0], [home]

    def go(column: int, target: float, speed: float) -> None:
        displacement = abs(target - positions[-1][column])
        if displacement > 0.0:
            knots.append(knots[-1] + max(displacement / speed, 2.0 * CORNER))
            positions.append(np.where(np.arange(len(home)) == column, target, positions[-1]))
        knots.append(knots[-1] + dwell)
        positions.append(positions[-1])

    for column, joint in enumerate(joints):
        top = machine.limits[joint].slower_speed * (1.0 - margins.velocity)
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
    refuse(found, f"sweeps '{name}'", "lower the speeds, or raise the margins")
    return trajectory


def _widest(
    clear: ClearPoses, lowest: np.ndarray, highest: np.ndarray
) -> tuple[np.ndarray, list[tuple[float, float]]]:
    """Pose whose narrowest sweep is widest, and the sweeps' ends; none if none is clear."""
    count = poses_per_joint(len(lowest), REST_POSES, MOST_REST_POSES)
    shares = (np.arange(count) + 0.5) / count
    grid = np.stack(np.meshgrid(*[shares] * len(lowest), indexing="ij"), axis=-1)
    best, chosen, ends = 0.0, lowest, []
    for pose in lowest + grid.reshape(-1, len(lowest)) * (highest - lowest):
        reach = [
            _reach(clear, pose, column, lowest[column], highest[column])
            for column in range(len(pose))
        ]
        spans = zip(reach, highest - lowest, strict=True)
        width = min((high - low) / span for (low, high), span in spans)
        if width > best:
            best, chosen, ends = width, pose, reach
    return np.round(chosen, DECIMALS), ends


def _reach(
    poses: ClearPoses, pose: np.ndarray, column: int, low: float, high: float
) -> tuple[float, float]:
    """How far joint `column` can go from the pose either way while the tip keeps its clearance."""
    positions = np.tile(pose, (CLEARANCE_POINTS, 1))
    positions[:, column] = np.linspace(low, high, CLEARANCE_POINTS)
    clear = poses.at(positions)
    here = int(np.abs(positions[:, column] - pose[column]).argmin())
    if not clear[here]:
        return float(pose[column]), float(pose[column])
    blocked = np.flatnonzero(~clear)
    first = blocked[blocked < here].max(initial=-1) + 1
    last = blocked[blocked > here].min(initial=CLEARANCE_POINTS) - 1
    return float(positions[first, column]), float(positions[last, column])


@dataclass(frozen=True)
class FourierDraws:
    """Random Fourier series (32) of the period and harmonics of a problem, and others near one."""

    problem: ExcitationProblem

    def draw(self, rng: np.random.Generator) -> FourierTrajectory | None:
        """A series within the limits; None if the one that was drawn is not."""
        return self._checked(self.problem.random_point(rng))

    def varied(
        self, trajectory: FourierTrajectory, rng: np.random.Generator
    ) -> FourierTrajectory | None:
        """Another one near it; None if that is not within the limits."""
        point = trajectory.coefficients
        size = np.sqrt((point[1:] ** 2).mean(axis=0))
        wave = np.concatenate([[1.0], *[1.0 / np.arange(1, self.problem.harmonics + 1)] * 2])
        change = SERIES_VARIATION * size * wave[:, None] * rng.standard_normal(point.shape)
        return self._checked(self.problem.start_limits.repaired((point + change).ravel()))

    def _checked(self, point: np.ndarray) -> FourierTrajectory | None:
        problem = self.problem
        for share in SERIES_SHARES:
            drawn = np.round(problem.start_limits.drawn_home(point, share), DECIMALS)
            trajectory = FourierTrajectory.from_coefficients(
                "discrimination", problem.period, problem.model.joints, drawn.reshape(problem.shape)
            )
            if not problem.check(trajectory):
                return trajectory
        return None


@dataclass(frozen=True)
class CourseDraws:
    """Random courses of straight legs of all `joints`, above all of `asked`, and others near one:
    sweeps of one joint at many speeds, both ways, up to the ends of its range and from many poses,
    with dwells.

    Of about a `period` [s], and at most `LARGEST_FACTOR` times that; within limits and margins.
    """

    machine: Machine
    joints: tuple[str, ...]
    asked: tuple[str, ...]
    clearance: Clearance
    margins: Margins
    period: float

    def draw(self, rng: np.random.Generator) -> SweepTrajectory | None:
        """A course within the limits; None if the one that was drawn is not."""
        poses, times = [self._pose(rng)], [0.0]

        def go(to: np.ndarray, share: float) -> None:
            displacement = to - poses[-1]
            most = max(self._time(displacement, SPEEDS[1]), LONGEST_LEG * self.period)
            times.append(times[-1] + min(self._time(displacement, share), most))
            poses.append(to)

        while times[-1] < self.period:
            share = float(np.exp(rng.uniform(*np.log(SPEEDS))))
            to = self._pose(rng)
            if rng.uniform() < ALONE:
                column = self.joints.index(str(rng.choice(self.asked)))
                lowest, highest = self.margins.positions(self.machine, self.joints)
                place = to[column]
                if rng.uniform() < AT_AN_END:
                    place = lowest[column] if rng.uniform() < 0.5 else highest[column]
                to = np.where(np.arange(len(to)) == column, place, poses[-1])
            go(to, share)
            if rng.uniform() < DWELLS:
                times.append(times[-1] + rng.uniform(*DWELL))
                poses.append(poses[-1])
        go(poses[0], SPEEDS[1])
        return self._checked(np.array(poses), np.diff(times))

    def varied(
        self, trajectory: SweepTrajectory, rng: np.random.Generator
    ) -> SweepTrajectory | None:
        """Another one near it; None if that is not within the limits."""
        courses = [trajectory.joints[joint] for joint in self.joints]
        poses = np.array([course.position for course in courses]).T.copy()
        legs = np.diff(courses[0].time)
        lowest, highest = self.margins.positions(self.machine, self.joints)
        knot = int(rng.integers(1, len(poses)))
        if rng.uniform() < 0.5 and knot < len(poses) - 1:
            moved = poses[knot] + KNOT_SHIFT * rng.standard_normal(len(lowest)) * (highest - lowest)
            poses[knot] = np.clip(moved, lowest, highest)
        else:
            legs[knot - 1] *= np.exp(LEG_STRETCH * rng.standard_normal())
        least = [self._time(displacement, SPEEDS[1]) for displacement in np.diff(poses, axis=0)]
        return self._checked(poses, np.maximum(legs, least))

    def _checked(self, poses: np.ndarray, legs: np.ndarray) -> SweepTrajectory | None:
        for slower in SLOWER:
            times = np.round(np.concatenate([[0.0], np.cumsum(slower * legs)]), DECIMALS).tolist()
            if times[-1] > LARGEST_FACTOR * self.period:
                return None
            courses = zip(self.joints, np.round(poses, DECIMALS).T.tolist(), strict=True)
            trajectory = SweepTrajectory(
                kind="sweep",
                name="discrimination",
                period=times[-1],
                corner=CORNER,
                joints={
                    joint: JointCourse(time=tuple(times), position=tuple(course))
                    for joint, course in courses
                },
            )
            passed = trajectory_violations(self.machine, trajectory, self.clearance)
            if not passed:
                return trajectory
            if any(violation.quantity != "pump flow" for violation in passed):
                return None
        return None

    def _time(self, displacement: np.ndarray, share: float) -> float:
        """Duration of a leg at a share of the smaller limit of the velocity [s]."""
        fastest = self.machine.ranges(self.joints).slower_speed
        needed = np.abs(displacement) / (fastest * (1.0 - self.margins.velocity) * share)
        return max(float(needed.max()), 2.0 * CORNER)

    def _pose(self, rng: np.random.Generator) -> np.ndarray:
        """A pose at which the tip has its clearance; `ConfigurationError` if there is none."""
        clear = ClearPoses(self.machine, self.joints, self.clearance, self.margins)
        lowest, highest = self.margins.positions(self.machine, self.joints)
        for _ in range(POSE_ATTEMPTS):
            pose: np.ndarray = rng.uniform(lowest, highest)
            if not clear.known or clear.at(pose[np.newaxis])[0]:
                return pose
        raise ConfigurationError(f"{self.clearance}: none of {POSE_ATTEMPTS} poses {clear.remedy}")
