"""The position estimator: readings as they come, in any order, to an estimate for each window."""

import math
from collections import deque
from enum import Enum
from typing import NamedTuple

import numpy as np

from crane_model.array import Array, Flags
from crane_model.machine import Machine
from crane_model.model_file import Model
from crane_observer.position.balance import Known
from crane_observer.position.filter import Hypotheses, Observability
from crane_observer.position.flow import (
    FLOW_SUMS,
    MOST_BY_WEIGHT,
    SPOOL,
    Commands,
    add_interval,
    spools_of,
)
from crane_observer.position.state import (
    HEAVIEST_SHARE,
    MISSING_SHARE,
    FlowWindow,
    PoseEstimate,
    Trust,
)

POSITION_WINDOW = 0.05  # s
WINDOW_EARLY = 0.002  # s, before its time, that a window may end
PRESSURE_GAP = 0.1  # s without pressures, which are then lost
STALE_ENCODER = 0.1  # s, of a reading of an encoder that still counts
SILENT = 0.5  # s without a command, after which the valves count as closed; or without supply
NEUTRAL = 1e-6  # of the stroke
ENCODER_DEVIATION = 1e-4  # rad or m, of a reading, at least
THIRD_DIFFERENCE = 20.0  # variance of third differences of white noise, over its own
NOISE_READINGS = 1000  # that tell the noise
OUTLYING_READING = 5.0  # standard deviations of noise, of which no more count
START_DEVIATION = 1e-3  # rad or m, of a start that is known
LOOK_BACK = 100  # windows, that can be gone through again
LOAD_CERTAIN = 3.0  # standard deviations


class EstimatorCondition(Enum):
    """Fault of the readings; the estimate goes on as well as it can."""

    WAITING = "waiting for pressures"
    GOOD = "good"
    PRESSURES_LOST = "pressures lost: positions drift until they are back"
    COMMANDS_LOST = "commands lost while a valve was open: it counts as closed"
    SUPPLY_LOST = "supply is no longer measured: its last value is used"
    ENCODER_LOST = "an encoder is lost: its position comes from flow and force"
    VALVES_UNKNOWN = (
        "a joint without encoder has a valve that is not identified: only its weight is used"
    )
    UNSERVED = (
        "several joints without encoder have valves that are not identified: do not rely on them"
    )
    SEARCHING = "start not known: several poses are possible"
    LOAD_IMPOSSIBLE = "the forces imply an impossible load at the tip: do not rely on it"


class ReadingNoise:
    """White noise of the readings of s sensors, by their third differences: motion is smooth.

    Readings that repeat do not count: a joint that rests tells nothing of rounding.
    """

    def __init__(self, sensors: int, least: float):
        self.deviation = np.full(sensors, least)
        self._least, self._count = least, np.zeros(sensors)
        self._variance = np.zeros(sensors)
        self._last: deque[Array] = deque(maxlen=4)

    def add(self, shown: Array) -> None:
        """Take readings (s,); NaN of a sensor without one."""
        self._last.append(shown)
        if len(self._last) < 4:
            return
        third = np.array([-1.0, 3.0, -3.0, 1.0]) @ np.array(self._last)
        square = third**2 / THIRD_DIFFERENCE
        counted = np.isfinite(square) & (square > 0.0)
        known = self._count > THIRD_DIFFERENCE
        square = np.where(known, np.minimum(square, OUTLYING_READING**2 * self._variance), square)
        self._count += counted
        weight = counted / np.clip(self._count, 1.0, NOISE_READINGS)
        self._variance += weight * (np.where(counted, square, 0.0) - self._variance)
        self.deviation[:] = np.maximum(self._least, np.sqrt(self._variance))


class WindowEstimate(NamedTuple):
    """Result of a window of j joints."""

    estimate: PoseEstimate
    condition: EstimatorCondition
    observable: Flags  # (j,) by an encoder, or by the force balance of the last half minute
    measured: Flags  # (j,) by an encoder


class PositionEstimator:
    """Positions and load at the tip from pressures, valve commands and the encoders that are left.

    Times are in seconds; arrays (j,) are in the order of the joints of the model.

    Parameters
    ----------
    model
        Identified model with a machine; without hydraulics, valves are assumed.
    position
        Where it starts (j,) [rad, m]; NaN of joints that may be anywhere.
    deviation
        Standard deviation of the start [rad, m].
    trust
        How far the model is trusted; by default as its standard deviations deserve.

    Raises
    ------
    ConfigurationError
        The model lacks a machine, values, or pressure transducers.
    """

    def __init__(
        self,
        model: Model,
        position: Array,
        deviation: float = START_DEVIATION,
        trust: Trust | None = None,
    ):
        self.model = model
        joints = len(model.joints)
        self._noise = ReadingNoise(joints, ENCODER_DEVIATION)
        known = Known.of(model, self._noise.deviation, trust)
        self._pressure_noise = ReadingNoise(2 * joints, known.trust.reading)
        self._known, self._spools = known, spools_of(known.mechanics.model)
        self._commands, self._spool = Commands.none(joints), np.zeros(joints, SPOOL)
        self._hypotheses = Hypotheses(known, position, np.full(joints, deviation))
        span = known.high - known.low
        unknown = known.trust.unknown
        self._observability = Observability(known.layout, span, known.spread, unknown)
        self._sums = np.zeros(joints, FLOW_SUMS)
        self._begin = self._newest = np.nan
        self._before = self._last = np.zeros((2, joints))
        self._supply, self._supplied = known.circuit.supply_pressure, np.nan
        self._blind, self._silenced = 0.0, False
        self._commanded, self._command = -np.inf, np.zeros(joints)
        self._latency = self.machine.latency(model.joints)
        self._largest = self.machine.hydraulics.transducer_range
        self._encoder_time = np.full(joints, -np.inf)
        self._encoder = np.full(joints, np.nan)
        self._once_measured = np.zeros(joints, dtype=bool)
        self._distrusted = np.zeros(joints, dtype=bool)
        self._past: deque[tuple[Hypotheses, FlowWindow]] = deque(maxlen=LOOK_BACK)
        self._velocity = np.zeros(joints)
        self.late = 0  # readings that came after newer ones, and were left out
        self.invalid = 0  # readings that were no numbers

    @property
    def hypotheses(self) -> Hypotheses:
        """Hypotheses after the last window."""
        return self._hypotheses

    @property
    def window(self) -> FlowWindow:
        """The last one that was complete; `IndexError` before there is one."""
        return self._past[-1][1]

    @property
    def machine(self) -> Machine:
        """The machine of the model."""
        return self._known.mechanics.machine

    def add_encoders(self, time: float, position: Array) -> None:
        """Take readings of the encoders.

        Parameters
        ----------
        time
            Their stamp [s].
        position
            Positions (j,) [rad, m]; NaN of a joint without encoder.
        """
        self._noise.add(position)
        shown = time - self._latency
        newer = np.isfinite(position) & (shown > self._encoder_time) & ~self._distrusted
        self._encoder = np.where(newer, position, self._encoder)
        self._encoder_time = np.where(newer, shown, self._encoder_time)
        self._once_measured |= newer

    def distrust(self, joint: int, since: float) -> None:
        """Stop using an encoder, and go through the last seconds again without it.

        Parameters
        ----------
        joint
            Place of the joint in the model.
        since
            From when its readings are not to be used [s].
        """
        self._distrusted[joint] = True
        self._encoder_time[joint] = -np.inf
        again = [window for _, window in self._past if window.time > since]
        if not again:
            return
        while len(self._past) > len(again):
            self._past.popleft()
        self._hypotheses = self._past[0][0]
        self._past.clear()
        for window in again:
            encoders = window.encoders.copy()
            encoders[joint] = np.nan
            self._step(window._replace(encoders=encoders))

    def believe(self, joint: int) -> None:
        """Use the encoder of a joint, by its place in the model, again."""
        self._distrusted[joint] = False

    def _step(self, window: FlowWindow) -> PoseEstimate:
        self._past.append((self._hypotheses.copied(), window))
        return self._hypotheses.step(window)

    def add_command(self, time: float, command: Array) -> None:
        """Take valve commands (j,) [-1..1], in force from `time` [s] on."""
        if not np.isfinite(command).all():
            self.invalid += 1
        elif time < self._commanded:
            self.late += 1
        else:
            self._commands.add(time, np.clip(command, -1.0, 1.0))
            self._commanded, self._command, self._silenced = time, command, False

    def add_pressures(
        self, time: float, chamber_a: Array, chamber_b: Array, supply: float
    ) -> WindowEstimate | None:
        """Take readings of the pressures, the clock of the estimator.

        Parameters
        ----------
        time
            Their stamp [s].
        chamber_a, chamber_b
            Pressures (j,) [Pa].
        supply
            Supply pressure [Pa]; if it is NaN, the last one that was measured counts.

        Returns
        -------
        WindowEstimate or None
            What is known after the window that these readings complete; None between two.
        """
        now = np.stack([chamber_a, chamber_b])
        if not np.isfinite(now).all():
            self.invalid += 1
            return None
        if np.isnan(self._newest):
            self._begin_window(time, now)
            self._newest, self._last = time, now
            return None
        if time <= self._newest:
            self.late += 1
            return None
        if np.isfinite(supply):
            self._supply, self._supplied = supply, time
        self._pressure_noise.add(now.ravel())
        np.max(self._pressure_noise.deviation.reshape(2, -1), axis=0, out=self._known.reading)
        passed = time - self._newest
        if passed > PRESSURE_GAP:
            self._blind += passed
            self._unheard = not self._commands.reach(self._newest)
        if time - self._commanded > SILENT and not self._silenced:
            self._silenced = True
            self._commands.add(self._commanded + SILENT, np.zeros_like(chamber_a))
        parts = math.ceil(passed / PRESSURE_GAP)  # a valve may open and close within a gap
        part, rise = passed / parts, (now - self._last) / parts
        for left in reversed(range(parts)):
            stamp, shown = time - left * part, now - left * rise
            add_interval(
                self._known.circuit, self._spools, self._commands, self._spool, self._begin,
                self._newest, stamp, self._last, shown, self._supply, self._largest, self._sums,
            )  # fmt: skip
            self._newest, self._last = stamp, shown
        return self._complete() if time - self._begin >= POSITION_WINDOW - WINDOW_EARLY else None

    def _begin_window(self, time: float, pressures: Array) -> None:
        self._begin, self._before, self._blind, self._unheard = time, pressures, 0.0, False
        self._sums[:] = 0.0

    def _complete(self) -> WindowEstimate:
        time = self._newest
        age = time - self._encoder_time
        measured = np.abs(age) < STALE_ENCODER
        encoders = self._encoder + self._velocity * np.where(measured, age, np.nan)
        cut_off = self._silenced and bool((np.abs(self._command) > NEUTRAL).any())
        duration = time - self._begin
        opened = (self._sums["null"] != 0.0).any(axis=1) | self._unheard
        blind = np.where(opened, self._blind, 0.0) + (duration if cut_off else 0.0)
        window = FlowWindow(
            time, duration, self._sums.copy(), self._before, self._last, encoders, blind,
            whole=not self._blind and not cut_off,
        )  # fmt: skip
        estimate = self._step(window)
        self._velocity = estimate.velocity
        self._observability.add(self._hypotheses.filters[0].rows, duration)
        unserved = self._known.assumed & ~measured
        unserved &= unserved.sum() > MOST_BY_WEIGHT
        condition = self._condition(estimate, measured, cut_off, bool(unserved.any()))
        self._begin_window(time, self._last)
        observable = measured | (self._observability.observable & ~unserved)
        return WindowEstimate(estimate, condition, observable, measured)

    def _condition(
        self, estimate: PoseEstimate, measured: Flags, cut_off: bool, unserved: bool
    ) -> EstimatorCondition:
        """The worst that is the case."""
        unsure, unknown = LOAD_CERTAIN * estimate.deviation[-1], self._known.trust.unknown
        least, most = -MISSING_SHARE * unknown - unsure, HEAVIEST_SHARE * unknown + unsure
        if not least < estimate.load < most:
            return EstimatorCondition.LOAD_IMPOSSIBLE
        if unserved:
            return EstimatorCondition.UNSERVED
        if cut_off:
            return EstimatorCondition.COMMANDS_LOST
        if self._blind:
            return EstimatorCondition.PRESSURES_LOST
        if self._newest - self._supplied > SILENT:  # which one that was never measured is not
            return EstimatorCondition.SUPPLY_LOST
        if (self._known.assumed & ~measured).any():
            return EstimatorCondition.VALVES_UNKNOWN
        if (self._once_measured & ~measured).any():
            return EstimatorCondition.ENCODER_LOST
        if len(self._hypotheses.filters) > 1:
            return EstimatorCondition.SEARCHING
        return EstimatorCondition.GOOD
