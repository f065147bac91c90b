"""The payload estimator: readings as they come, in any order, to an estimate for each window.

Means over a window are such that velocity and acceleration fit each other: with the weight
w(s) = (1 - s^2)^3, s from -1 to 1 over the window, the means of q, q' and q'' are

    Int w q,    -Int w' q,    Int w'' q,

each over Int w: so q is never differentiated, and forces averaged with w balance them.
"""

from collections.abc import Sequence
from enum import Enum
from typing import NamedTuple, Self

import numpy as np
from numba import njit

from crane_model.array import Array, Flags
from crane_model.errors import RangeError
from crane_model.machine import Machine
from crane_model.model_file import Model
from crane_observer.payload.filter import (
    MASS,
    Balanced,
    MeanMotion,
    ModelDoubt,
    TipBalance,
    TipLoad,
    TipMechanics,
    attainable,
)
from crane_observer.payload.flow_check import FlowCheck
from crane_observer.payload.hypotheses import LoadHypotheses
from crane_observer.position.state import STANDING
from crane_observer.recording import AlignedEncoders, CommandReading, EncoderReading, HeardRecording

PAYLOAD_WINDOW = 0.3  # s
HOP = 0.15  # s from one window to the next
WINDOW_OFFSET = 0.02  # s from the windows of other observers, so that no cycle has the work of all
HELD_READINGS = 256  # more than a window of the fastest sensors, at 400 Hz
FEWEST_READINGS = 6  # in a window
LONGEST_GAP = 0.25  # of a window, between two readings
PIECES = 6  # of a window, in which it is seen whether a joint stops or turns
LEVEL_NOISE, BEND_NOISE = 1.278, 8.37  # of n readings over a window of half width h [s], as `means`
# takes them: standard deviation of the level times sqrt(n), of the acceleration times sqrt(n) h^2
THIRD_DIFFERENCE = 20.0  # variance of third differences of white noise, over its own
LATEST_POSITION = 0.1  # s that positions may come after pressures
CRAWLING = 2.0  # times that: how fast friction becomes what it is in faster motion
WORST_SHARE = 0.1  # of `ModelDoubt.unknown`: deviation of the best estimate in a pose, to be one
TOLD_SHARE = 0.77  # of the filter's standard deviation: all that it allows for seldom comes
# together; set by lifts of 24 hard and 12 stock machines (`crane_benchmark loads`, seeds 94500 and
# 128800)

LIGHTEST_SHARE = 0.05  # of `ModelDoubt.unknown`: less was not lifted
SURE = 3.0  # standard deviations, by which a load is more than nothing
KEPT_ESTIMATES = 100  # of a lift, before the unneeded are forgotten
HEADINGS = (
    "picked_up [s]", "released [s]", "moved [s]", "load [kg]", "std_dev [kg]", "centre [m]",
    "centre.std_dev [m]",
)  # fmt: skip


class HeldReadings:
    """The newest readings of `width` sensors that are read together, in the order of stamps."""

    def __init__(self, width: int):
        self._time, self._values = np.empty(2 * HELD_READINGS), np.empty((2 * HELD_READINGS, width))
        self._count = 0
        self.late = 0  # readings that came after newer ones, and were left out
        self.invalid = 0  # readings with something that is no number

    @property
    def newest(self) -> float:
        """Stamp of the newest [s]; -inf before the first."""
        return float(self._time[self._count - 1]) if self._count else -np.inf

    @property
    def held(self) -> tuple[Array, Array]:
        """Stamps (n,) and values (n, width)."""
        return self._time[: self._count], self._values[: self._count]

    def between(self, begin: float, end: float) -> tuple[Array, Array]:
        """Stamps (n,) and values (n, width) from `begin` to `end` [s], both included."""
        time, values = self.held
        inside = slice(*np.searchsorted(time, [begin, np.nextafter(end, np.inf)]))
        return time[inside], values[inside]

    def add(self, time: float, values: Array) -> None:
        """One more, unless it is late."""
        if not np.isfinite(values).all():
            self.invalid += 1
        if not time > self.newest:
            self.late += 1
            return
        if self._count == len(self._time):
            self._time[:HELD_READINGS] = self._time[HELD_READINGS:]
            self._values[:HELD_READINGS] = self._values[HELD_READINGS:]
            self._count = HELD_READINGS
        self._time[self._count], self._values[self._count] = time, values
        self._count += 1

    @classmethod
    def of(cls, time: Array, values: Array) -> Self:
        """All readings of a recording at once: stamps (n,) and values (n, width)."""
        kept = np.diff(np.maximum.accumulate(time), prepend=-np.inf) > 0.0
        readings = cls(values.shape[1])
        readings._time, readings._values = time[kept], np.ascontiguousarray(values[kept])
        readings._count = int(kept.sum())
        readings.late = len(kept) - readings._count
        readings.invalid = int((~np.isfinite(values)).any(axis=1).sum())
        return readings


@njit(cache=True, error_model="numpy")
def means(time: Array, values: Array, begin: float, end: float) -> Array:
    """(3, k) means of `values` (n, k) at increasing `time` (n,) [s], of their rate and of the rate
    of that, between `begin` and `end`. Values that are no numbers do not count; NaN of columns
    whose readings do not fill the window.
    """
    out = np.full((3, values.shape[1]), np.nan)
    first, last = np.searchsorted(time, begin), np.searchsorted(time, end, side="right")
    half, middle = 0.5 * (end - begin), 0.5 * (begin + end)
    rows = np.empty(last - first, dtype=np.int64)
    for k in range(values.shape[1]):
        count, gap, newest = 0, 0.0, begin
        for i in range(first, last):
            if np.isfinite(values[i, k]):
                gap, newest = max(gap, time[i] - newest), time[i]
                rows[count] = i
                count += 1
        gap = max(gap, end - newest)
        if count < FEWEST_READINGS or gap > 2.0 * half * LONGEST_GAP:
            continue
        # about the chord, whose share is known without an integral
        t0, y0 = time[rows[0]], values[rows[0], k]
        slope = (values[rows[count - 1], k] - y0) / (time[rows[count - 1]] - t0)
        area, level, rate, bend = 0.0, 0.0, 0.0, 0.0
        for c in range(count):
            before = time[rows[c - 1]] if c > 0 else begin
            after = time[rows[c + 1]] if c < count - 1 else end
            share = 0.5 * (after - before) / half
            s = (time[rows[c]] - middle) / half
            inside = max(1.0 - s * s, 0.0)
            away = share * (values[rows[c], k] - y0 - slope * (time[rows[c]] - t0))
            area += share * inside**3
            level += away * inside**3
            rate += away * 6.0 * s * inside**2
            bend += away * inside * (24.0 * s * s - 6.0 * inside)
        out[0, k] = y0 + slope * (middle - t0) + level / area
        out[1, k] = slope + rate / (half * area)
        out[2, k] = bend / (half * half * area)
    return out


@njit(cache=True, error_model="numpy")
def noise_of_mean(time: Array, values: Array, begin: float, end: float) -> Array:
    """(k, k) covariance of white noise of `values` (n, k) between `begin` and `end` [s], by their
    third differences, over their number: what motion changes is smooth. 0 where none are known.
    """
    first, last = np.searchsorted(time, begin), np.searchsorted(time, end, side="right")
    shown = values[first:last]
    third = shown[3:] - 3.0 * shown[2:-1] + 3.0 * shown[1:-2] - shown[:-3]
    third = np.where(np.isfinite(third), third, 0.0)
    return third.T @ third / (THIRD_DIFFERENCE * max(len(third), 1) * max(len(shown), 1))


@njit(cache=True, error_model="numpy")
def slowest_and_fastest(time: Array, values: Array, begin: float, end: float) -> Array:
    """(2, k): least and largest rate of `values` (n, k) in any of the `PIECES` of the window."""
    out = np.full((2, values.shape[1]), np.nan)
    first, last = np.searchsorted(time, begin), np.searchsorted(time, end, side="right")
    piece = (end - begin) / PIECES
    rows = np.empty(last - first, dtype=np.int64)
    for k in range(values.shape[1]):
        count = 0
        for i in range(first, last):
            if np.isfinite(values[i, k]):
                rows[count] = i
                count += 1
        if count < 2:
            continue
        slowest, fastest, before, c = np.inf, -np.inf, 0.0, 1
        for edge in range(PIECES + 1):
            # linear between two readings, constant beyond the first and the last
            at = min(max(begin + edge * piece, time[rows[0]]), time[rows[count - 1]])
            while time[rows[c]] < at:
                c += 1
            t0, y0 = time[rows[c - 1]], values[rows[c - 1], k]
            value = y0 + (values[rows[c], k] - y0) * (at - t0) / (time[rows[c]] - t0)
            if edge > 0:
                slowest = min(slowest, (value - before) / piece)
                fastest = max(fastest, (value - before) / piece)
            before = value
        out[0, k], out[1, k] = slowest, fastest
    return out


class PayloadCondition(Enum):
    """What is wrong with what comes in, or with the pose; in the order of gravity."""

    WAITING = "waiting for pressures and positions"
    PRESSURES_LOST = "pressures lost, of a joint or all: no estimate until they are back"
    POSITIONS_LOST = "positions lost: no estimate until they are back, or estimated"
    ENCODER_IN_DOUBT = (
        "an encoder contradicts the flow into its cylinder: no estimate until both agree, or the "
        "sensor monitor has found the fault"
    )
    UNOBSERVABLE = "this pose permits no estimate: move the load where it pulls at a joint"
    POSITIONS_ESTIMATED = "a position is estimated, and the load by it"
    AT_REST = "at rest: dry friction hides part of the load; move it to estimate it better"
    GOOD = "estimated in motion"


WITHOUT_ESTIMATE = (
    PayloadCondition.WAITING, PayloadCondition.PRESSURES_LOST, PayloadCondition.POSITIONS_LOST,
    PayloadCondition.ENCODER_IN_DOUBT, PayloadCondition.UNOBSERVABLE,
)  # fmt: skip


class PayloadEstimate(NamedTuple):
    """What is known of the payload after a window."""

    time: float  # s, at its end
    load: TipLoad
    condition: PayloadCondition
    changed: bool  # a load came or went: it was noticed now
    since: float  # s, when this load came or went; -inf if it was there from the beginning
    moved: float  # s of motion since then
    lightest: float  # kg, below which nothing was lifted


class PayloadEstimator:
    """What hangs at the tip of the machine of a model; times in seconds, arrays (j,) in the order
    of its joints.
    """

    def __init__(self, model: Model, doubt: ModelDoubt | None = None):
        """`ConfigurationError` names what the model lacks."""
        self.model = model
        self._mechanics = TipMechanics.of(model)
        joints = len(model.joints)
        doubt = doubt or ModelDoubt.of(model)
        self._hypotheses = LoadHypotheses(doubt, joints)
        self._lightest = LIGHTEST_SHARE * doubt.unknown  # kg
        self._worst = WORST_SHARE * doubt.unknown
        self._flow = FlowCheck(model) if model.hydraulics else None
        self._wrong_since = np.full(joints, np.inf)  # s, of an encoder that was found faulty
        self._wrong_pressures = np.zeros(joints, dtype=bool)
        self._standing = STANDING * self.machine.ranges(model.joints).slower_speed
        self._aligned = AlignedEncoders(self.machine.latency(model.joints))
        self.pressures, self.encoders = HeldReadings(2 * joints), HeldReadings(joints)
        self.estimates = HeldReadings(3 * joints)
        self._end, self._estimated_until, self._compared = np.nan, np.nan, -np.inf
        self._doubted_until = np.full(joints, -np.inf)  # s, each encoder by flow
        self._believed = np.full(joints, -np.inf)  # s, until when each encoder was used as measured
        self._moved = 0.0

    @property
    def machine(self) -> Machine:
        return self._mechanics.machine

    @property
    def late(self) -> int:
        """Readings that came after newer ones, and were left out."""
        return self.pressures.late + self.encoders.late + self.estimates.late

    @property
    def invalid(self) -> int:
        """Readings that were no numbers."""
        return self.pressures.invalid + self.encoders.invalid + self.estimates.invalid

    def tare(self) -> None:
        """What hangs at the tip counts as nothing from now on."""
        self._hypotheses.tare()

    def distrust(self, encoders: Array, pressures: Flags) -> None:
        """Leave out what is faulty: encoders (j,) since a time [s], infinite of a sound one, and
        `pressures` (j,) of joints. The load is forgotten if a faulty encoder has been used.
        """
        newly = (self._believed > encoders + PAYLOAD_WINDOW) & (encoders < self._wrong_since)
        self._wrong_since, self._wrong_pressures = encoders, pressures
        if newly.any():
            self._hypotheses.forget()

    def add_command(self, time: float, command: Array) -> None:
        """Valve commands (j,) [-1..1], in force from `time` [s] on."""
        if self._flow is not None:
            self._flow.add_command(time, command)

    def add_encoders(self, time: float, position: Array) -> None:
        """Readings [rad, m]; NaN of a joint whose encoder is not to be believed."""
        self.encoders.add(*self._aligned.at(time, position))

    def add_estimate(self, time: float, position: Array, velocity: Array, deviation: Array) -> None:
        """What the position estimator tells, for joints without encoder [rad, m]."""
        self.estimates.add(time, np.concatenate([position, velocity, deviation]))

    def add_pressures(
        self, time: float, chamber_a: Array, chamber_b: Array, supply: float = np.nan
    ) -> list[PayloadEstimate]:
        """Readings [Pa], the clock of all; NaN where nothing was measured. The estimates of all
        windows that are complete by now.
        """
        if self._flow is not None:
            self._flow.add_supply(supply)
        newest = self.pressures.newest
        self.pressures.add(time, np.concatenate([chamber_a, chamber_b]))
        begins = not np.isfinite(self._end) or time - newest > PAYLOAD_WINDOW
        if begins and np.isfinite(self.pressures.newest):
            self._end = self.pressures.newest + WINDOW_OFFSET + PAYLOAD_WINDOW
        found = []
        while self._end <= time:
            if time < self._end + LATEST_POSITION and self.encoders.newest < self._end:
                break  # positions may still come
            found.append(self._estimate(self._end))
            self._end += HOP
        return found

    def recorded_estimates(
        self, encoders: HeldReadings, pressures: HeldReadings
    ) -> list[PayloadEstimate]:
        """The estimates of a whole recording: those of its readings one by one, but sooner."""
        self.encoders, self.pressures = encoders, pressures
        (known, _), (time, _) = encoders.held, pressures.held
        found = []
        for part in np.split(time, np.flatnonzero(np.diff(time) > PAYLOAD_WINDOW) + 1):
            if not len(part):
                continue
            last, self._end = float(part[-1]), float(part[0]) + WINDOW_OFFSET + PAYLOAD_WINDOW
            newest = (
                known[np.searchsorted(known, last, side="right") - 1] if len(known) else -np.inf
            )
            newest = newest if newest <= last else -np.inf  # none by then
            while self._end <= last and (
                last >= self._end + LATEST_POSITION or newest >= self._end
            ):
                found.append(self._estimate(self._end))
                self._end += HOP
        return found

    def _estimate(self, end: float) -> PayloadEstimate:
        motion, (slowest, fastest), deviation = self._motion(end)
        doubted, measured = self._contradicted(end), deviation == 0.0
        if not np.isfinite(motion.position).all():
            return self._told(end, PayloadCondition.POSITIONS_LOST)
        try:
            balance = self._mechanics.balance(motion)
        except RangeError:  # no encoder of this machine can show that
            return self._told(end, PayloadCondition.POSITIONS_LOST)
        if np.isnan(balance.force).any():
            return self._told(end, PayloadCondition.PRESSURES_LOST)
        if (doubted & measured).any():
            return self._told(end, PayloadCondition.ENCODER_IN_DOUBT)
        self._believed[measured] = end
        estimated = not measured.all()
        by_place = np.zeros((len(deviation), len(deviation)))
        if estimated:
            load = float(self._hypotheses.believed.filter.x[MASS])
            by_place = self._mechanics.slopes(motion, load) * deviation
        since = self._estimated_until
        window = Balanced(
            HOP if np.isnan(since) else max(end - since, HOP),
            balance,
            (slowest > self._standing) | (fastest < -self._standing),
            np.maximum(-slowest, fastest) < self._standing,
            fastest > 0.0,
            np.exp(-np.abs(motion.velocity) / (CRAWLING * self._standing)),
            by_place,
            ~measured,
            *self._noise(end, balance),
        )
        changed = self._hypotheses.add(end, window)
        self._estimated_until = end
        self._moved = 0.0 if changed else self._moved + HOP * bool(window.moving.any())
        condition = PayloadCondition.GOOD
        if attainable(self._hypotheses.believed.filter, window) > self._worst:
            condition = PayloadCondition.UNOBSERVABLE
        elif estimated:
            condition = PayloadCondition.POSITIONS_ESTIMATED
        elif window.standing.all():
            condition = PayloadCondition.AT_REST
        return self._told(end, condition, changed)

    def _motion(self, end: float) -> tuple[MeanMotion, Array, Array]:
        """Also (2, j) least and largest speeds within the window, and (j,) standard deviations of
        the positions; 0 where encoders measure them.
        """
        j = len(self._standing)
        begin = end - PAYLOAD_WINDOW
        time, shown = self.encoders.between(begin, end)
        shown = np.where(time[:, np.newaxis] > self._wrong_since, np.nan, shown)
        q, v, a = means(time, shown, begin, end)
        p = means(*self.pressures.held, begin, end)[0]
        p[np.tile(self._wrong_pressures, 2)] = np.nan
        speeds, deviation = slowest_and_fastest(time, shown, begin, end), np.zeros(j)
        lost = ~np.isfinite(q)
        if lost.any():
            estimate = means(*self.estimates.held, begin, end)
            told = slowest_and_fastest(*self.estimates.held, begin, end)[:, :j]
            speeds = np.where(lost, told, speeds)
            q = np.where(lost, estimate[0, :j], q)
            v = np.where(lost, estimate[0, j : 2 * j], v)
            a = np.where(lost, estimate[1, j : 2 * j], a)
            deviation = np.where(lost, estimate[0, 2 * j :], deviation)
        return MeanMotion(q, v, a, p[:j], p[j:]), speeds, deviation

    def _noise(self, end: float, balance: TipBalance) -> tuple[Array, Array]:
        """(j,) standard deviation of the balance by noise of the pressures [N m, N], and (j, j)
        covariance of the accelerations by that of the encoders.
        """
        begin = end - PAYLOAD_WINDOW
        shaken = noise_of_mean(*self.encoders.held, begin, end)
        shaken *= (BEND_NOISE / (0.5 * PAYLOAD_WINDOW) ** 2) ** 2
        pressure = LEVEL_NOISE**2 * np.diag(noise_of_mean(*self.pressures.held, begin, end))
        piston = np.sum(np.split(pressure, 2), axis=0)
        return np.sqrt(balance.by_pressure**2 @ piston), shaken

    def _contradicted(self, end: float) -> Flags:
        """(j,) whether the flow contradicts each encoder, or has done so within the window."""
        time, shown = self.encoders.held
        clock, pressures = self.pressures.between(self._compared, end)
        if self._flow is not None and len(clock) > 1 and len(time):
            self._compared = float(clock[-1])
            at = np.stack([np.interp(clock[[0, -1]], time, column) for column in shown.T], axis=1)
            doubted = self._flow.add_window(clock, pressures, *at)
            self._doubted_until[doubted] = end + PAYLOAD_WINDOW
        return end < self._doubted_until

    def _told(
        self, end: float, condition: PayloadCondition, changed: bool = False
    ) -> PayloadEstimate:
        load = self._hypotheses.load
        load = load._replace(deviation=TOLD_SHARE * load.deviation)
        since = self._hypotheses.believed.since
        return PayloadEstimate(end, load, condition, changed, since, self._moved, self._lightest)


def replay(
    estimator: PayloadEstimator, recording: HeardRecording, tared: float = np.nan
) -> list[PayloadEstimate]:
    """The numbers as while the recording was made; tare at `tared` [s], NaN: never."""
    found: list[PayloadEstimate] = []
    for reading in recording.readings():
        if isinstance(reading, EncoderReading):
            estimator.add_encoders(*reading)
        elif isinstance(reading, CommandReading):
            estimator.add_command(*reading)
        else:
            if reading.time >= tared:
                estimator.tare()
                tared = np.nan
            found += estimator.add_pressures(*reading)
    return found


class Lift(NamedTuple):
    """One load from its pick-up to its release, or to the end of what was heard."""

    picked_up: float  # s; of the first estimate, where it hung there from the beginning
    released: float  # s
    moved: float  # s of motion in which it was estimated
    load: TipLoad  # as it was known best

    def row(self, zero: float = 0.0) -> list[str]:
        """Cells below `HEADINGS`; times since `zero` [s] before those of the lift."""
        times = (f"{zero + time:.3f}" for time in (self.picked_up, self.released))
        return [*times, *(f"{value:.6g}" for value in (self.moved, *self.load))]


def lifts(estimates: Sequence[PayloadEstimate]) -> list[Lift]:
    """All lifts among estimates in their order."""
    log = LiftLog()
    ended = [*(log.add(estimate) for estimate in estimates), log.end()]
    return [lift for lift in ended if lift is not None]


def lift_of(part: Sequence[PayloadEstimate], first: float) -> Lift | None:
    """What hung there in estimates between two changes, if anything did; `first` [s]: when it was
    estimated for the first time.
    """
    told = [estimate for estimate in part if estimate.condition not in WITHOUT_ESTIMATE]
    if not told:
        return None
    best = min(told, key=lambda estimate: estimate.load.deviation)
    if best.load.mass <= max(best.lightest, SURE * best.load.deviation):
        return None
    moved = max(estimate.moved for estimate in told)
    return Lift(max(best.since, first), part[-1].time, moved, best.load)


class LiftLog:
    """Lifts as they end, from estimates as they come; it remembers the best of each alone."""

    def __init__(self) -> None:
        self._first: float | None = None
        self._part: list[PayloadEstimate] = []

    def add(self, estimate: PayloadEstimate) -> Lift | None:
        """The lift that has ended by this estimate."""
        if self._first is None:
            self._first = estimate.time
        ended = None
        if estimate.changed:
            ended = lift_of(self._part, self._first)
            self._part = []
        self._part.append(estimate)
        if len(self._part) > KEPT_ESTIMATES:
            self._part = self._shortened(self._part)
        return ended

    def end(self) -> Lift | None:
        """The lift that hangs there still."""
        return lift_of(self._part, self._first or 0.0)

    def _shortened(self, part: list[PayloadEstimate]) -> list[PayloadEstimate]:
        """What `lift_of` looks at: the best, the longest moved and the last."""
        told = [estimate for estimate in part if estimate.condition not in WITHOUT_ESTIMATE]
        if not told:
            return part[-1:]
        best = min(told, key=lambda estimate: estimate.load.deviation)
        moved = max(told, key=lambda estimate: estimate.moved)
        return [best, moved, part[-1]]
