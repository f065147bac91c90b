"""The motion of one experiment: from rest onto the trajectory, N periods of it, and back to rest.

The crane first moves from where it stands, on a straight line in joint space, to a point of the
trajectory shortly before its start. From there the *clock* of the trajectory is started: it runs up
smoothly from standing still to its normal rate, and runs down again after the last period. So
start and stop follow the path of the trajectory itself and are never faster than it: where the
trajectory respects limits of position, velocity, stroke, pump flow and clearance, so do they.
Position, velocity and acceleration are continuous throughout.
"""

import math
from bisect import bisect_right
from collections.abc import Callable
from copy import copy
from dataclasses import dataclass, replace
from enum import IntEnum
from functools import cached_property
from typing import NamedTuple, cast

import numpy as np
from numba import njit

from crane_model.errors import RangeError
from crane_model.machine import Machine
from crane_trajectory.motion.check import (
    GRID_PER_PERIOD,
    Clearance,
    Violation,
    check_joints,
    pump_flow,
    refuse,
    violations,
)
from crane_trajectory.motion.periodic import (
    FourierTrajectory,
    Instants,
    JointCourse,
    JointSeries,
    PeriodicTrajectory,
    SweepTrajectory,
    instants,
)
from crane_trajectory.motion.points import PointsTrajectory

RUN_UP = 4.0  # s in which the clock reaches its normal rate, and in which it stops again
APPROACH_SHARE = 0.5  # of the velocity limits and of the pump flow, used on the way to the start
SHORTEST_APPROACH = 1.0  # s
LONGEST_APPROACH = 600.0  # s
LONGEST_MOTION = 24 * 3600.0  # s
# The largest deceleration on a stop is 1.5 times the speed by this time: at the limits of speed of
# the laboratory crane 0.2 rad/s2 to 0.7 m/s2.
BRAKE_TIME = 1.5  # s
LONGEST_STEP = 0.05  # s; after a longer gap, or a leap of the clock of the stamps, it goes on so


Course = tuple[np.ndarray, np.ndarray, np.ndarray]
"""A quantity over time, its first and its second derivative."""


class Phase(IntEnum):
    """Phase of the motion; numbers as in the feedback of RunExcitation."""

    REST = 0
    APPROACH = 1
    EXCITATION = 2
    STOP = 3


PHASES = (Phase.REST, Phase.APPROACH, Phase.EXCITATION, Phase.STOP, Phase.REST)  # in their order


class Reference(NamedTuple):
    """Reference of all joints at n times: (n, j) each [SI], and the phase (n,)."""

    position: np.ndarray
    velocity: np.ndarray
    acceleration: np.ndarray
    phase: np.ndarray


@dataclass(frozen=True, eq=False)
class Motion:
    """Periods of a trajectory with approach and stop; `plan` makes one that is checked.

    Parameters
    ----------
    machine
        The machine.
    trajectory
        The trajectory.
    start
        Where the crane stands at rest at time 0 (j,) [rad, m]; joints of the machine that the
        trajectory does not move are held there.
    periods
        How many whole periods are run.
    approach_time
        Time on the straight line to the trajectory [s].
    """

    machine: Machine
    trajectory: PeriodicTrajectory
    start: np.ndarray
    periods: int
    approach_time: float

    @cached_property
    def run_up(self) -> float:
        """How long the clock runs up, and down [s]: not for a trajectory that begins at rest."""
        return 0.0 if isinstance(self.trajectory, PointsTrajectory) else RUN_UP

    @cached_property
    def excitation_start(self) -> float:
        """When the first whole period begins [s]; the trajectory's own time is 0 then."""
        return self.approach_time + self.run_up

    @cached_property
    def excitation_end(self) -> float:
        """When the last whole period ends [s]."""
        return self.excitation_start + self.periods * self.trajectory.period

    @cached_property
    def duration(self) -> float:
        """When the crane is at rest again [s]."""
        return self.excitation_end + self.run_up

    def reference(self, time: np.ndarray) -> Reference:
        """Evaluate the reference; at rest before 0 and after `duration`.

        Parameters
        ----------
        time
            Times of the motion (n,) [s].

        Returns
        -------
        Reference
            Position, velocity and acceleration (n, j) [SI] of all joints, and the phase (n,).
        """
        time = np.atleast_1d(np.asarray(time, dtype=float))
        on_line = time < self.approach_time
        line = self._line(time)
        path = self._path(time)
        phase = np.array(PHASES)[np.searchsorted(self._changes, time, side="right")]
        position, velocity, acceleration = (
            np.where(on_line[:, None], *courses) for courses in zip(line, path, strict=True)
        )
        return Reference(position, velocity, acceleration, phase)

    def at(self, time: float) -> np.ndarray:
        """Return the rows of `reference` (3, j) at one time [s], in compiled code, within 1e-12."""
        if time < self.approach_time:
            return _on_line(time, self.approach_time, self.start, self._displacement)
        if self.run_up:
            clock, rate, change = _clock_at(time, self.approach_time, self.excitation_end)
        else:
            clock, rate, change = time - self.approach_time, 1.0, 0.0
        moving = paced(self._instants(clock), rate, change)
        return _with_held(moving, self._columns, self.start)

    def phase(self, time: float) -> Phase:
        """Return the phase of the motion at one time [s]."""
        return PHASES[bisect_right(self._changes, time)]

    def probe(self, time: np.ndarray) -> np.ndarray:
        """Return what the trajectory adds to the commands (n, j) [-1..1] at times (n,) [s]."""
        added = np.zeros((len(time), len(self.start)))
        probe, since = self.trajectory.probe, time - self.excitation_start
        if probe is not None:
            leading = (since >= 0.0) & (time < self.excitation_end)
            moved = probe.course(since, self.trajectory.period, len(self._columns))
            added[:, self._columns] = np.where(leading[:, np.newaxis], moved, 0.0)
        return added

    def violations(self, clearance: Clearance) -> list[Violation]:
        """Check the motion from start to rest.

        Parameters
        ----------
        clearance
            Clearance that the boom tip keeps.

        Returns
        -------
        list of Violation
            Every limit that a joint, the pump or the tip passes, by its worst value.
        """
        first_period = replace(self, periods=1)  # as all others
        step = self.trajectory.period / self.trajectory.harmonics / GRID_PER_PERIOD
        step = min(step, SHORTEST_APPROACH / GRID_PER_PERIOD)
        grid = np.linspace(
            0.0, first_period.duration, int(np.ceil(first_period.duration / step)) + 1
        )
        return violations(
            self.machine,
            self.machine.joint_names,
            lambda time: first_period.reference(time)[:2],
            grid,
            clearance,
        )

    def _line(self, time: np.ndarray) -> Course:
        displacement = self._displacement
        share, rate, change = _rest_to_rest(time / self.approach_time)
        return (
            self.start + np.outer(share, displacement),
            np.outer(rate, displacement / self.approach_time),
            np.outer(change, displacement / self.approach_time**2),
        )

    def _path(self, time: np.ndarray) -> Course:
        clock, rate, change = self._clock(time)
        samples = self.trajectory.evaluate(clock)
        rate, change = rate[:, None], change[:, None]
        return (
            self._all_joints(samples.position, self.start),
            self._all_joints(samples.velocity * rate, 0.0),
            self._all_joints(samples.acceleration * rate**2 + samples.velocity * change, 0.0),
        )

    def _clock(self, time: np.ndarray) -> Course:
        """The trajectory's own time [s], its rate and the change of its rate [1/s]."""
        if not self.run_up:
            return time - self.approach_time, np.ones_like(time), np.zeros_like(time)
        up, up_rate, up_change = running_up((time - self.approach_time) / RUN_UP)
        down, down_rate, down_change = running_up((time - self.excitation_end) / RUN_UP)
        return (
            RUN_UP * (up - down - 0.5),  # passes 0 when it has run up
            up_rate - down_rate,
            (up_change - down_change) / RUN_UP,
        )

    @cached_property
    def _changes(self) -> tuple[float, ...]:
        """When one of `PHASES` gives way to the next [s]."""
        return 0.0, self.excitation_start, self.excitation_end, self.duration

    @cached_property
    def _displacement(self) -> np.ndarray:
        """(j,): from the start to where the clock starts to run."""
        position = self.trajectory.evaluate(np.array([-self.run_up / 2])).position
        return np.asarray(self._all_joints(position, self.start)[0] - self.start)

    @cached_property
    def _columns(self) -> np.ndarray:
        return np.array([self.machine.index(joint) for joint in self.trajectory.joint_names])

    @cached_property
    def _instants(self) -> Instants:
        return instants(self.trajectory)

    def _all_joints(self, moving: np.ndarray, held: np.ndarray | float) -> np.ndarray:
        values = np.empty((len(moving), len(self.start)))
        values[:] = held
        values[:, self._columns] = moving
        return values


def plan(
    machine: Machine,
    trajectory: PeriodicTrajectory,
    start: np.ndarray,
    periods: int,
    clearance: Clearance,
) -> Motion:
    """Plan the motion from rest through periods of a trajectory to rest.

    The approach is as short as a share of the velocity limits and of the pump flow allows.

    Parameters
    ----------
    machine
        The machine.
    trajectory
        The trajectory.
    start
        Where the crane stands (j,) [rad, m].
    periods
        How many whole periods to run.
    clearance
        Clearance that the boom tip keeps.

    Returns
    -------
    Motion
        The motion, checked from start to rest.

    Raises
    ------
    RangeError
        The motion would pass a limit, each of which is listed, or would take too long; or the
        machine lacks a joint of the trajectory.
    """
    start = np.asarray(start, dtype=float)
    joints = machine.joint_names
    if start.shape != (len(joints),) or not np.isfinite(start).all():
        raise RangeError(f"start: one finite position for each of {', '.join(joints)}, got {start}")
    if periods < 1:
        raise RangeError(f"periods: at least 1, got {periods}")
    if periods > 1 and isinstance(trajectory, PointsTrajectory):
        raise RangeError(f"periods: a motion through points is run once, got {periods}")
    check_joints(machine, trajectory)
    approach = _approach_time(machine, trajectory, start)
    if not approach <= LONGEST_APPROACH:  # nor where it cannot be told
        raise RangeError(
            f"trajectory '{trajectory.name}' from {_pose(machine, start)}: the way to its start "
            f"would take {approach:.4g} s, at most {LONGEST_APPROACH:g} s are allowed; are its "
            "positions in rad and m?"
        )
    motion = Motion(machine, trajectory, start, periods, approach)
    if motion.duration > LONGEST_MOTION:
        raise RangeError(
            f"periods: {periods} of {trajectory.period:g} s would move the crane for "
            f"{motion.duration / 3600:.4g} h, at most {LONGEST_MOTION / 3600:g} h are allowed; "
            "run fewer periods"
        )
    refuse(
        motion.violations(clearance),
        f"trajectory '{trajectory.name}' from {_pose(machine, start)}",
        "start from another pose, lower the amplitude or lengthen the period",
    )
    return motion


def _approach_time(machine: Machine, trajectory: PeriodicTrajectory, start: np.ndarray) -> float:
    """Time [s] at which the line to the trajectory uses its share of speed and pump flow."""
    in_one_second = Motion(machine, trajectory, start, 1, approach_time=1.0)
    line = in_one_second.reference(np.linspace(0.0, 1.0, 200, endpoint=False))
    limits = [machine.limits[joint] for joint in machine.joint_names]
    used = np.maximum(
        line.velocity / [limit.velocity_max for limit in limits],
        line.velocity / [limit.velocity_min for limit in limits],
    )
    most = used.max()
    if machine.supply:
        flow = pump_flow(machine, machine.joint_names, line.position, line.velocity)
        most = max(most, flow.max() / machine.supply.pump_flow)
    return float(np.maximum(most / APPROACH_SHARE, SHORTEST_APPROACH))  # which keeps nan


def _pose(machine: Machine, position: np.ndarray) -> str:
    return ", ".join(
        f"{joint} {value:.4g} {unit}"
        for (joint, unit), value in zip(machine.units.items(), position, strict=True)
    )


def _rest_to_rest(share: np.ndarray) -> Course:
    """The quintic from 0 to 1, at rest without acceleration at both ends of 0 <= share <= 1."""
    s = np.minimum(np.maximum(share, 0.0), 1.0)
    return (
        s**3 * (10.0 - 15.0 * s + 6.0 * s**2),
        30.0 * s**2 * (1.0 - s) ** 2,
        60.0 * s * (1.0 - s) * (1.0 - 2.0 * s),
    )


def running_up(share: np.ndarray) -> Course:
    """0 until share 0, then a rate that rises smoothly from 0 to 1 until share 1 and stays."""
    s = np.minimum(np.maximum(share, 0.0), 1.0)
    beyond = np.maximum(share - 1.0, 0.0)
    return s**3 * (1.0 - s / 2.0) + beyond, s**2 * (3.0 - 2.0 * s), 6.0 * s * (1.0 - s)


Once = Callable[[float], tuple[float, float, float]]
_rest_to_rest_once = cast(Once, njit(cache=True)(_rest_to_rest))  # for one instant
running_up_once = cast(Once, njit(cache=True)(running_up))


@njit(cache=True)
def _on_line(time: float, duration: float, start: np.ndarray, path: np.ndarray) -> np.ndarray:
    """A straight line in joint space at one time [s]: (3, j)."""
    share, rate, change = _rest_to_rest_once(time / duration)
    point = np.empty((3, len(start)))
    point[0] = start + share * path
    point[1] = rate * (path / duration)
    point[2] = change * (path / duration**2)
    return point


@njit(cache=True)
def _clock_at(time: float, begin: float, end: float) -> tuple[float, float, float]:
    """`Motion._clock` at one time [s], if the clock starts to run at `begin` and down at `end`."""
    up, up_rate, up_change = running_up_once((time - begin) / RUN_UP)
    down, down_rate, down_change = running_up_once((time - end) / RUN_UP)
    return RUN_UP * (up - down - 0.5), up_rate - down_rate, (up_change - down_change) / RUN_UP


@njit(cache=True)
def paced(point: np.ndarray, rate: float, change: float) -> np.ndarray:
    """A point (3, j) of a path whose clock has this rate and change of its rate [1/s]."""
    slowed = point.copy()
    slowed[1] = point[1] * rate
    slowed[2] = point[2] * rate**2 + point[1] * change
    return slowed


@njit(cache=True)
def _with_held(moving: np.ndarray, columns: np.ndarray, held: np.ndarray) -> np.ndarray:
    """(3, j) of all joints, of which the `columns` move; the others rest where they are held."""
    point = np.zeros((3, len(held)))
    point[0] = held
    for i in range(len(columns)):
        point[:, columns[i]] = moving[:, i]
    return point


def compile_reference(machine: Machine) -> None:
    """Once, before the crane moves: the first references take seconds."""
    joint, rest = machine.joint_names[0], np.zeros(len(machine.joint_names))
    series = JointSeries(offset=0.0, sine=(0.0,), cosine=(0.0,))
    course = JointCourse(time=(0.0, 1.0), position=(0.0, 0.0))
    for trajectory in (
        FourierTrajectory(name="", period=1.0, joints={joint: series}),
        SweepTrajectory(kind="sweep", name="", period=1.0, corner=0.1, joints={joint: course}),
    ):
        motion = Motion(machine, trajectory, rest, 1, approach_time=1.0)
        for time in (0.0, 1.0):  # on the line, and on the path
            paced(motion.at(time), 1.0, 0.0)


class Target(NamedTuple):
    """The reference of one instant: (j,) each [SI], and the phase."""

    position: np.ndarray
    velocity: np.ndarray
    acceleration: np.ndarray
    phase: Phase


class ReferenceClock:
    """Time of a motion in real time, from `start` [s] on, at the rate 1 until it brakes.

    Braking runs the clock down smoothly, so the reference comes to rest on the path that was
    checked, never faster than it, within `BRAKE_TIME`.
    """

    def __init__(self, start: float):
        self.time = start
        self._braked_at: float | None = None  # time of the motion
        self._braking = 0.0  # s since

    @property
    def braking(self) -> bool:
        return self._braked_at is not None

    @property
    def stopped(self) -> bool:
        return self.braking and self._braking >= BRAKE_TIME

    def brake(self) -> None:
        if self._braked_at is None:
            self._braked_at = self.time

    def advance(self, dt: float) -> None:
        """Let `dt` [s] of real time pass; at most `LONGEST_STEP` and never back."""
        dt = min(max(dt, 0.0), LONGEST_STEP)
        if self._braked_at is None:
            self.time += dt
            return
        self._braking = min(self._braking + dt, BRAKE_TIME)
        lost = BRAKE_TIME * self._run_down()[0]
        self.time = self._braked_at + self._braking - lost

    def later(self, time: float) -> "ReferenceClock":
        """As it will be in `time` [s], if nobody brakes meanwhile."""
        clock = copy(self)
        for _ in range(math.ceil(time / LONGEST_STEP)):
            clock.advance(min(time, LONGEST_STEP))
            time -= LONGEST_STEP
        return clock

    def target(self, motion: Motion) -> Target:
        point, phase = motion.at(self.time), motion.phase(self.time)
        if self.braking:
            _, lost_rate, change = self._run_down()
            point, phase = paced(point, 1.0 - lost_rate, -change / BRAKE_TIME), Phase.STOP
        position, velocity, acceleration = point
        return Target(position, velocity, acceleration, phase)

    def _run_down(self) -> tuple[float, float, float]:
        """Time, rate and change of its rate that the clock has lost, in units of `BRAKE_TIME`."""
        return running_up_once(self._braking / BRAKE_TIME)
