"""Random candidate motions: courses of straight legs and Fourier series (32) within the limits."""

from dataclasses import dataclass

import numpy as np

from crane_model.errors import ConfigurationError
from crane_model.machine import Machine
from crane_trajectory.excitation.limits import Margins
from crane_trajectory.excitation.search import DECIMALS, ExcitationProblem
from crane_trajectory.motion.check import Clearance, TipRoom, trajectory_violations
from crane_trajectory.motion.periodic import FourierTrajectory, JointCourse, SweepTrajectory

# Random Fourier series (32) within the limits, and others near one of them.

SHARES = (1.0, 0.97, 0.9, 0.8)  # of a series, tried in turn until it is within the limits
VARIATION = 0.25  # of a series, rms over that of its waves


@dataclass(frozen=True)
class FourierDraws:
    """Of the period and harmonics of a problem."""

    problem: ExcitationProblem

    def draw(self, rng: np.random.Generator) -> FourierTrajectory | None:
        """One that is within the limits; None if the one that was drawn is not."""
        return self._checked(self.problem.random_point(rng))

    def varied(
        self, trajectory: FourierTrajectory, rng: np.random.Generator
    ) -> FourierTrajectory | None:
        """Another one near it; None if that is not within the limits."""
        point = trajectory.coefficients
        size = np.sqrt((point[1:] ** 2).mean(axis=0))
        wave = np.concatenate([[1.0], *[1.0 / np.arange(1, self.problem.harmonics + 1)] * 2])
        change = VARIATION * size * wave[:, None] * rng.standard_normal(point.shape)
        return self._checked(self.problem.start_limits.mend((point + change).ravel()))

    def _checked(self, point: np.ndarray) -> FourierTrajectory | None:
        problem = self.problem
        for share in SHARES:
            drawn = np.round(self.problem.start_limits.drawn_home(point, share), DECIMALS)
            trajectory = FourierTrajectory.from_coefficients(
                "settling", problem.period, problem.model.joints, drawn.reshape(problem.shape)
            )
            if not problem.check(trajectory):
                return trajectory
        return None


# Random courses of straight legs: sweeps of one joint at many speeds, both ways, up to the ends of
# its range and from many poses, with dwells. The finest of them are drawn again, a little
# different.

CORNER = 0.5  # s
PLACES = 6
SPEEDS = (0.03, 0.95)  # of the limit, drawn evenly in ratios
ALONE, AT_AN_END, DWELLS = 0.6, 0.4, 0.3  # how often one joint moves alone, to an end, and dwells
DWELL = (0.5, 3.0)  # s
LARGEST_FACTOR = 1.5  # of the period: with its way back, and varied
LONGEST = 0.25  # of the period: a leg, so that there are several
ATTEMPTS = 200  # to find a pose that leaves the tip its room
SLOWER = (1.0, 1.3, 1.7)  # times as long, where the pump does not suffice
SHIFT, STRETCH = 0.15, 0.4  # of a knot: of the range, and of the log of the time of a leg


@dataclass(frozen=True)
class CourseDraws:
    """Of all `joints`, above all of `asked`, within the limits less the margins.

    Of about a `period` [s], and at most `LARGEST_FACTOR` times that.
    """

    machine: Machine
    joints: tuple[str, ...]
    asked: tuple[str, ...]
    clearance: Clearance
    margins: Margins
    period: float

    def draw(self, rng: np.random.Generator) -> SweepTrajectory | None:
        """One that is within the limits; None if the one that was drawn is not."""
        poses, times = [self._pose(rng)], [0.0]

        def go(to: np.ndarray, share: float) -> None:
            way = to - poses[-1]
            most = max(self._time(way, SPEEDS[1]), LONGEST * self.period)
            times.append(times[-1] + min(self._time(way, share), most))
            poses.append(to)

        while times[-1] < self.period:
            share = float(np.exp(rng.uniform(*np.log(SPEEDS))))
            to = self._pose(rng)
            if rng.uniform() < ALONE:
                column = self.joints.index(str(rng.choice(self.asked)))
                lowest, highest = self._range
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
        lowest, highest = self._range
        knot = int(rng.integers(1, len(poses)))
        if rng.uniform() < 0.5 and knot < len(poses) - 1:
            moved = poses[knot] + SHIFT * rng.standard_normal(len(lowest)) * (highest - lowest)
            poses[knot] = np.clip(moved, lowest, highest)
        else:
            legs[knot - 1] *= np.exp(STRETCH * rng.standard_normal())
        least = [self._time(way, SPEEDS[1]) for way in np.diff(poses, axis=0)]
        return self._checked(poses, np.maximum(legs, least))

    def _checked(self, poses: np.ndarray, legs: np.ndarray) -> SweepTrajectory | None:
        for slower in SLOWER:
            times = np.round(np.concatenate([[0.0], np.cumsum(slower * legs)]), PLACES).tolist()
            courses = zip(self.joints, np.round(poses, PLACES).T.tolist(), strict=True)
            if times[-1] > LARGEST_FACTOR * self.period:
                return None
            trajectory = SweepTrajectory(
                kind="sweep",
                name="settling",
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
            if any(one.quantity != "pump flow" for one in passed):
                return None
        return None

    def _time(self, way: np.ndarray, share: float) -> float:
        """Of a leg at a share of the smaller limit of the velocity [s]."""
        limits = [self.machine.limits[joint] for joint in self.joints]
        fastest = np.array([min(one.velocity_max, -one.velocity_min) for one in limits])
        needed = np.abs(way) / (fastest * (1.0 - self.margins.velocity) * share)
        return max(float(needed.max()), 2.0 * CORNER)

    def _pose(self, rng: np.random.Generator) -> np.ndarray:
        """One at which the tip has its room; `ConfigurationError` if there is none."""
        room, keep = TipRoom(self.machine), self.clearance.kept + self.margins.room
        lowest, highest = self._range
        for _ in range(ATTEMPTS):
            pose: np.ndarray = rng.uniform(lowest, highest)
            if not set(room.joints) <= set(self.joints):
                return pose
            if (room.at(self.joints, pose[np.newaxis])[0] >= keep).all():
                return pose
        raise ConfigurationError(
            f"{self.clearance}: none of {ATTEMPTS} poses within Table 2 keeps the boom tip clear "
            f"by this and a margin of {self.margins.room} m; lower the clearance or the margin"
        )

    @property
    def _range(self) -> tuple[np.ndarray, np.ndarray]:
        """Lowest and highest positions (j,), less the margins."""
        limits = [self.machine.limits[joint] for joint in self.joints]
        lowest, highest = np.array([(one.position_min, one.position_max) for one in limits]).T
        free = self.margins.position * (highest - lowest)
        return lowest + free, highest - free
