"""One experiment in real time: moves the crane and brings it, whatever happens, to rest.

    LEADING   the reference runs; a controller, by default (36), follows it
    BRAKING   the reference runs down along its own path
    SETTLING  the reference stands; the controller brings the crane to it
    RELEASING the command ramps to neutral and stays there: the valves hold the crane
    OVER

Canceling and deactivation brake. Where there is nothing to control by, or control has failed
(states lost, tracking lost, driver in fault), the valves are released at once. The first and the
last commands are neutral, as the driver asks. Pure: it knows no ROS and reads no clock.
"""

import math
from collections import deque
from collections.abc import Mapping
from enum import Enum, IntEnum, auto

import numpy as np

from crane_model.errors import RangeError
from crane_trajectory.control.controller import (
    Blend,
    ChamberPressures,
    ControlCondition,
    Controller,
    Point,
    SensorReading,
    Tuning,
    Wanted,
    command,
    gravest,
)
from crane_trajectory.motion.motion import Motion, Phase, ReferenceClock, Target

NEUTRAL_BEFORE = 0.3  # s, in which driver and publisher find each other and see neutral commands
LONGEST_SETTLING = 3.0  # s; a crane that still swings is held by its valves
RELEASE_TIME_S = 0.2  # from full spool to neutral; commands that just stop, the driver ramps
NEUTRAL_AFTER = 0.2  # s, in which the driver surely sees that commands end at neutral
CLOCK_SET_BACK_S = 0.05  # by which stamps go back if their clock was set
REST_TIME_S = 0.5  # over which the mean velocity of a joint at rest is below its standstill speed


class Standstill:
    """Whether joints are at rest, by their mean velocity over `REST_TIME_S`: the noise of inertial
    sensors, above the standstill speed, averages out.
    """

    def __init__(self) -> None:
        self._since = math.inf  # when velocities began to come
        self._limits = np.zeros(0)  # (j,)
        self._newest: deque[tuple[float, np.ndarray]] = deque()

    def forget(self) -> None:
        self._since = math.inf
        self._newest.clear()

    def add(self, velocity: np.ndarray, tuning: Tuning, now: float) -> None:
        """Take velocities (j,) [rad/s, m/s], and the standstill speeds in force."""
        self._since = min(self._since, now)
        self._limits = tuning.gains.standstill_speed
        self._newest.append((now, np.array(velocity, dtype=float)))
        while self._newest[0][0] <= now - REST_TIME_S:
            self._newest.popleft()

    def reached(self, now: float) -> bool:
        """Return whether all joints are at rest; false if a velocity is unknown."""
        if now - self._since < REST_TIME_S:
            return False
        mean = np.mean([velocity for _, velocity in self._newest], axis=0)
        return bool((np.abs(mean) < self._limits).all())


class PeriodicError:
    """Root mean square of the tracking error over whole periods; a begun period does not count."""

    def __init__(self, joints: int, start: float, period: float, periods: int):
        """Make a log of (j,) joints; the periods begin at the time `start` [s] of the motion."""
        self._start, self._period, self._periods = start, period, periods
        self._current = 0
        self._whole, self._begun = np.zeros((2, joints))
        self._whole_count = self._begun_count = 0

    def add(self, time: float, error: np.ndarray) -> None:
        """The error (j,) at a time [s] of the motion; times rise."""
        index = math.floor((time - self._start) / self._period)
        if index > self._current:
            self._whole += self._begun
            self._whole_count += self._begun_count
            self._begun[:], self._begun_count = 0.0, 0
            self._current = index
        if 0 <= index < self._periods:
            self._begun += error**2
            self._begun_count += 1

    @property
    def rms(self) -> np.ndarray:
        """(j,) [rad, m]; NaN if no period is whole."""
        if not self._whole_count:
            return np.full_like(self._whole, np.nan)
        return np.sqrt(self._whole / self._whole_count)


def beyond(error: np.ndarray, tolerance: np.ndarray, units: Mapping[str, str]) -> str:
    """Names the joints whose error (j,) is beyond the tolerance (j,); empty if there is none.

    `units` of the joints are those of their machine.
    """
    far = np.abs(error) > tolerance
    if not far.any():
        return ""
    return "; ".join(
        f"{joint}: tracking error {error[i]:.4g} {unit} is beyond the tolerance "
        f"{tolerance[i]:.4g} {unit}"
        for i, (joint, unit) in enumerate(units.items())
        if far[i]
    )


class Outcome(IntEnum):
    """How an experiment has ended; numbers as in the result of RunExcitation."""

    COMPLETED = 1
    CANCELED = 2
    TRAJECTORY_REFUSED = 3
    NOT_READY = 4
    TRACKING_LOST = 5
    STATES_LOST = 6
    DEACTIVATED = 7
    DRIVER_FAULT = 8
    FAILED = 9


class Stage(Enum):
    """Stage of the experiment; see the head of this file."""

    LEADING = auto()
    BRAKING = auto()
    SETTLING = auto()
    RELEASING = auto()
    OVER = auto()


class Experiment:
    """Moves the crane and brings it to rest.

    `sample` is called with every joint state and `watch` regularly; their commands go to the
    valves.

    Parameters
    ----------
    motion
        The motion.
    tuning
        Gains of (36), largest command and tracking tolerance.
    states_timeout
        Silence of joint states after which the valves are released [s].
    now
        Time of the steady clock [s].
    controller
        Leads the crane; by default (36) with the gains of the tuning.
    """

    def __init__(
        self,
        motion: Motion,
        tuning: Tuning,
        states_timeout: float,
        now: float,
        controller: Controller | None = None,
    ):
        self.motion = motion
        self.stage = Stage.LEADING
        self.outcome = Outcome.COMPLETED
        run = "every period" if motion.run_up else "the motion"
        self.message = f"{run} has been run and the crane is at rest"
        self.target: Target | None = None  # None while no reference is followed
        self._units = motion.machine.units
        self.tracking_error = np.zeros(len(self._units))  # (j,) rad, m: reference minus measured
        self._clock = ReferenceClock(-NEUTRAL_BEFORE)
        self._tuning = Blend(tuning)
        self._timeout = states_timeout
        self._error = PeriodicError(
            len(self._units), motion.excitation_start, motion.trajectory.period, motion.periods
        )
        self._stamp: float | None = None
        self._heard = now
        self._command = np.zeros(len(self._units))
        self._commanded = now
        self._entered = now  # the stage
        self._standstill = Standstill()
        self._noted: dict[ControlCondition, str] = {}
        self._controller = controller
        if controller is not None:
            controller.start(self._command)

    @property
    def over(self) -> bool:
        """Return whether the crane is at rest and the last command was neutral."""
        return self.stage is Stage.OVER

    @property
    def elapsed(self) -> float:
        """Time of the motion [s]."""
        return max(self._clock.time, 0.0)

    @property
    def rms(self) -> np.ndarray:
        """Root mean square of the tracking error over whole periods (j,); NaN without one."""
        return self._error.rms

    @property
    def controlled(self) -> str:
        """How its controller is doing, in words."""
        if self._controller is None:
            return ControlCondition.FOLLOWING.text
        return gravest(self._controller.conditions, tuple(self._units))

    @property
    def account(self) -> str:
        """The message, and what befell the controller on the way, with the first time of each."""
        return "; ".join((self.message, *self._noted.values()))

    def retune(self, tuning: Tuning) -> None:
        """Change the controller; the command does not jump."""
        self._tuning.to(tuning)

    def stop(self, outcome: Outcome, message: str) -> None:
        """Bring the crane to rest along its path; nothing if it is coming to rest already."""
        if self.stage is Stage.LEADING:
            self.outcome, self.message = outcome, message
            self._clock.brake()
            self.stage = Stage.BRAKING

    def release(self, outcome: Outcome, message: str, now: float) -> None:
        """Ramp to neutral at once; nothing if that has begun."""
        if self.stage in (Stage.LEADING, Stage.BRAKING, Stage.SETTLING):
            self.outcome, self.message = outcome, message
            self._release(now)

    def fail(self, why: str, now: float) -> None:
        """Ramp to neutral for a defect of the program. It is over if the ramp, too, does not end in
        its time: commands that just stop, the driver brings to neutral.
        """
        self.release(Outcome.FAILED, why, now)
        if self.stage is Stage.RELEASING and now - self._entered > RELEASE_TIME_S + NEUTRAL_AFTER:
            self.stage = Stage.OVER

    def sample(
        self,
        stamp: float,
        position: np.ndarray,
        velocity: np.ndarray,
        now: float,
        pressures: ChamberPressures | None = None,
    ) -> np.ndarray | None:
        """Answer a joint state.

        Parameters
        ----------
        stamp
            Stamp of the joint state, of any clock of the driver's [s].
        position, velocity
            Joint state (j,) [SI].
        now
            Time of the steady clock [s].
        pressures
            The newest pressures; None if there are none.

        Returns
        -------
        numpy.ndarray or None
            Valve commands (j,) [-1..1]; None when the experiment is over.
        """
        dt = stamp - self._stamp if self._stamp is not None else 0.0
        self._stamp, self._heard = stamp, now
        if dt < -CLOCK_SET_BACK_S:
            self.stop(
                Outcome.STATES_LOST,
                f"the clock of the joint states was set back by {-dt:.2f} s, limit "
                f"{CLOCK_SET_BACK_S:g} s; stop what sets it, and run again",
            )
        dt = max(dt, 0.0)
        tuning = self._tuning.advance(dt)
        self._standstill.add(velocity, tuning, now)
        if self.stage in (Stage.LEADING, Stage.BRAKING, Stage.SETTLING):
            self._clock.advance(dt)
            try:
                return self._follow(dt, position, velocity, pressures, tuning, now)
            except RangeError as error:
                self.release(Outcome.STATES_LOST, str(error), now)
        return self._ramp(now)

    def watch(self, now: float) -> np.ndarray | None:
        """A command (j,) if one is due although no joint state has come, else None."""
        silent = now - self._heard
        if silent > self._timeout:
            self.release(
                Outcome.STATES_LOST,
                f"no joint states for {silent * 1e3:.0f} ms, limit {self._timeout * 1e3:.0f} ms; "
                "see /diagnostics of the driver",
                now,
            )
            self._standstill.forget()
            return self._ramp(now)
        return None

    def _follow(
        self,
        dt: float,
        position: np.ndarray,
        velocity: np.ndarray,
        pressures: ChamberPressures | None,
        tuning: Tuning,
        now: float,
    ) -> np.ndarray | None:
        target = self.target = self._clock.target(self.motion)
        if self._controller is None:
            u = command(
                tuning.gains, position, velocity, target.position, target.velocity, self._units
            )
        else:
            shown = pressures or ChamberPressures.none(len(position))
            u = self._controlled(
                self._controller,
                dt,
                SensorReading(position, velocity, *shown),
                target,
                tuning.saturation,
            )
            conditions = self._controller.conditions
            if any(condition.stops for condition in conditions):
                unknown = ControlCondition.NOT_MEASURED in conditions
                why = Outcome.STATES_LOST if unknown else Outcome.TRACKING_LOST
                self.release(why, gravest(conditions, tuple(self._units)), now)
                return self._ramp(now)
            self._note(conditions)
        self.tracking_error = target.position - position
        self._error.add(self._clock.time, self.tracking_error)
        if lost := beyond(self.tracking_error, tuning.tolerance, self._units):
            self.release(Outcome.TRACKING_LOST, lost, now)
            return self._ramp(now)
        if self.stage is Stage.LEADING and self.motion.trajectory.probe is not None:
            u = u + self.motion.probe(np.array([self._clock.time]))[0]
        largest = tuning.saturation
        self._command, self._commanded = np.minimum(np.maximum(u, -largest), largest), now
        if self._clock.time < 0.0:
            self._command = np.zeros(len(self._units))
        self._proceed(tuning, now)
        return self._command

    def _note(self, conditions: tuple[ControlCondition, ...]) -> None:
        for condition in set(conditions) - self._noted.keys():
            if condition > ControlCondition.FOLLOWING:
                joint = tuple(self._units)[conditions.index(condition)]
                self._noted[condition] = f"{joint} at {self.elapsed:.1f} s: {condition.text}"

    def _controlled(
        self,
        controller: Controller,
        dt: float,
        reading: SensorReading,
        target: Target,
        largest: float,
    ) -> np.ndarray:
        """Command of the controller, which is shown the reference ahead, too."""
        ahead = self._clock.later(controller.preview).target(self.motion)
        began, period = self.motion.excitation_start, self.motion.trajectory.period
        leading = self.stage is Stage.LEADING and target.phase is Phase.EXCITATION
        phase = (self._clock.time - began) % period if leading else np.nan
        wanted = Wanted(Point(*target[:3]), Point(*ahead[:3]), phase, largest)
        return controller.command(dt, reading, wanted)

    def _proceed(self, tuning: Tuning, now: float) -> None:
        """To the next stage, if this one has done its work."""
        if self.stage is Stage.SETTLING:
            # at most twice the position tolerance, where F_f crosses the dead band in full
            near = 2.0 * tuning.gains.position_tolerance
            there = bool((np.abs(self.tracking_error) <= near).all())
            if (there and self._standstill.reached(now)) or now - self._entered > LONGEST_SETTLING:
                self._release(now)
        elif self._clock.stopped or self._clock.time >= self.motion.duration:
            self.stage, self._entered = Stage.SETTLING, now

    def _release(self, now: float) -> None:
        self.stage, self._entered, self.target = Stage.RELEASING, now, None

    def _ramp(self, now: float) -> np.ndarray | None:
        """The command on the way to neutral; over when it has been there for long enough."""
        if self.over:
            return None
        step = max(now - self._commanded, 0.0) / RELEASE_TIME_S
        size = np.maximum(np.abs(self._command) - step, 0.0)
        self._command, self._commanded = np.copysign(size, self._command), now
        neutral_for = now - self._entered - RELEASE_TIME_S
        unknown = now - self._heard > self._timeout
        if neutral_for > NEUTRAL_AFTER and (
            unknown or self._standstill.reached(now) or neutral_for > LONGEST_SETTLING
        ):
            self.stage = Stage.OVER
        return self._command


class Readiness:
    """State of the crane, and what of it prevents an experiment. Pure: it knows no ROS and reads no
    clock; `now` is of the steady clock [s].
    """

    def __init__(self) -> None:
        self.position: np.ndarray | None = None  # (j,) rad, m: the newest
        self._heard = -math.inf  # when the newest joint state came
        self._standstill = Standstill()

    def forget_states(self) -> None:
        self.position = None
        self._standstill.forget()

    def sample(
        self, position: np.ndarray, velocity: np.ndarray, tuning: Tuning, now: float
    ) -> None:
        """A joint state (j,), (j,) [SI] has come."""
        self.position, self._heard = position, now
        self._standstill.add(velocity, tuning, now)

    def lacking(self, states_timeout: float, now: float) -> str:
        """Obstacle to an experiment, with the remedy; empty if there is none."""
        if self.position is None or now - self._heard > states_timeout:
            return "no joint states arrive; start the driver and see its /diagnostics"
        if not self._standstill.reached(now):
            return "the crane is not at rest; bring it to rest"
        return ""

    def moved_from(self, start: np.ndarray, tuning: Tuning, units: Mapping[str, str]) -> str:
        """Joints off the start (j,) [SI] by more than half their tolerance; empty if none."""
        assert self.position is not None
        moved, most = np.abs(self.position - start), tuning.tolerance / 2
        return "; ".join(
            f"{joint}: moved by {moved[i]:.4g} {unit} while its motion was planned, half the "
            f"tolerance is {most[i]:.4g} {unit}"
            for i, (joint, unit) in enumerate(units.items())
            if moved[i] > most[i]
        )
