"""The scale: readings as they come, in any order, to a weighing for each window."""

from collections.abc import Sequence
from enum import Enum
from typing import NamedTuple

import numpy as np
from numba import njit

from crane_model.array import Array
from crane_model.errors import RangeError
from crane_model.machine import Machine
from crane_model.model_file import Model
from crane_observer.recording import ENCODERS, PRESSURES, HeardRecording
from crane_observer.scale.balance import MeanMotion, TipMechanics
from crane_observer.scale.changes import Histories
from crane_observer.scale.filter import MASS, Balanced, ModelDoubt
from crane_observer.scale.weighing import TipLoad, attainable

# The newest readings of some sensors, in the order of their stamps.

HELD = 256  # readings: more than a window of the fastest sensors, at 400 Hz


class HeldReadings:
    """Of `width` sensors that are read together."""

    def __init__(self, width: int):
        self._time, self._values = np.empty(2 * HELD), np.empty((2 * HELD, width))
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

    def add(self, time: float, values: Array) -> None:
        """One more, unless it is late."""
        if not np.isfinite(values).all():
            self.invalid += 1
        if not time > self.newest:
            self.late += 1
            return
        if self._count == len(self._time):
            self._time[:HELD] = self._time[HELD:]
            self._values[:HELD] = self._values[HELD:]
            self._count = HELD
        self._time[self._count], self._values[self._count] = time, values
        self._count += 1


# Means over a window whose velocity and acceleration fit each other, compiled.
#
# With the weight w(s) = (1 - s^2)^3, s from -1 to 1 over the window, the means of q, q' and q'' are
#
#     Int w q,    -Int w' q,    Int w'' q,
#
# each over Int w: so q is never differentiated, and forces averaged with w balance them.

FEWEST = 6  # readings in a window
LONGEST = 0.25  # of a window, between two readings
PIECES = 6  # of a window, in which it is seen whether a joint stops or turns


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
        if count < FEWEST or gap > 2.0 * half * LONGEST:
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
def slowest_and_fastest(time: Array, values: Array, begin: float, end: float) -> Array:
    """(2, k): least and largest rate of `values` (n, k) in any of the `PIECES` of the window."""
    out = np.empty((2, values.shape[1]))
    first, last = np.searchsorted(time, begin), np.searchsorted(time, end, side="right")
    edges = np.linspace(begin, end, PIECES + 1)
    for k in range(values.shape[1]):
        rows = np.flatnonzero(np.isfinite(values[first:last, k])) + first
        if len(rows) < 2:
            out[:, k] = np.nan
            continue
        rates = np.diff(np.interp(edges, time[rows], values[rows, k])) * PIECES / (end - begin)
        out[0, k], out[1, k] = rates.min(), rates.max()
    return out


WINDOW = 0.3  # s
HOP = 0.15  # s from one window to the next
APART = 0.02  # s from the windows of other observers, so that no cycle bears the work of all
LATEST = 0.1  # s that positions may come after pressures
STANDING = 0.02  # of the fastest that a joint may move, below which it counts as standing
CRAWLING = 2.0  # times that: how fast friction becomes what it is in faster motion
WORST = 10.0  # kg, standard deviation that the best weighing in a pose may have to be one: half of
# the lightest load that the aims ask for
TOLD = 0.77  # of the filter's standard deviation: all that it allows for seldom comes together; set
# by lifts of 24 hard and 12 stock machines (`crane_benchmark loads`, seeds 94500 and 128800)


class ScaleCondition(Enum):
    """What is wrong with what comes in, or with the pose; in the order of gravity."""

    WAITING = "waiting for pressures and positions"
    PRESSURES_LOST = "pressures lost, of a joint or all: nothing is weighed until they are back"
    POSITIONS_LOST = "positions lost: nothing is weighed until they are back, or estimated"
    UNOBSERVABLE = "this pose does not permit weighing: move the load where it pulls at a joint"
    POSITIONS_ESTIMATED = "a position is estimated: weighed with it"
    AT_REST = "at rest: dry friction hides part of the load; move it to weigh it better"
    GOOD = "weighed in motion"


class Weighing(NamedTuple):
    """After a window."""

    time: float  # s, at its end
    load: TipLoad
    condition: ScaleCondition
    changed: bool  # a load came or went: it was noticed now
    since: float  # s, when this load came or went; -inf if it was there from the beginning
    moved: float  # s of motion since then


class Scale:
    """What hangs at the tip of the machine of a model; times in seconds, arrays (j,) in the order
    of its joints.
    """

    def __init__(self, model: Model, doubt: ModelDoubt | None = None):
        """`ConfigurationError` names what the model lacks."""
        self.model = model
        self._mechanics = TipMechanics.of(model)
        joints = len(model.joints)
        self._histories = Histories(doubt or ModelDoubt.of(model), joints)
        limits = [self.machine.limits[joint] for joint in model.joints]
        fastest = np.array([min(-one.velocity_min, one.velocity_max) for one in limits])
        self._standing = STANDING * fastest
        self.pressures, self.encoders = HeldReadings(2 * joints), HeldReadings(joints)
        self.estimates = HeldReadings(3 * joints)
        self._end, self._weighed_until = np.nan, np.nan
        self._moved = 0.0

    @property
    def machine(self) -> Machine:
        """That of the model."""
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
        self._histories.tare()

    def add_encoders(self, time: float, position: Array) -> None:
        """Readings [rad, m]; NaN of a joint whose encoder is not to be believed."""
        self.encoders.add(time, position)

    def add_estimate(self, time: float, position: Array, velocity: Array, deviation: Array) -> None:
        """What the position sensor tells, for joints without encoder [rad, m]."""
        self.estimates.add(time, np.concatenate([position, velocity, deviation]))

    def add_pressures(self, time: float, chamber_a: Array, chamber_b: Array) -> list[Weighing]:
        """Readings [Pa], the clock of all; NaN where nothing was measured. The weighings of all
        windows that are complete by now.
        """
        newest = self.pressures.newest
        self.pressures.add(time, np.concatenate([chamber_a, chamber_b]))
        begins = not np.isfinite(self._end) or time - newest > WINDOW
        if begins and np.isfinite(self.pressures.newest):
            self._end = self.pressures.newest + APART + WINDOW
        found = []
        while self._end <= time:
            if time < self._end + LATEST and self.encoders.newest < self._end:
                break  # positions may still come
            found.append(self._weigh(self._end))
            self._end += HOP
        return found

    def _weigh(self, end: float) -> Weighing:
        motion, (slowest, fastest), deviation = self._motion(end)
        estimated = bool((deviation > 0.0).any())
        duration = HOP if np.isnan(self._weighed_until) else max(end - self._weighed_until, HOP)
        if not np.isfinite(motion.position).all():
            return self._told(end, ScaleCondition.POSITIONS_LOST)
        try:
            balance = self._mechanics.balance(motion)
        except RangeError:  # no encoder of this machine can show that
            return self._told(end, ScaleCondition.POSITIONS_LOST)
        if np.isnan(balance.force).any():
            return self._told(end, ScaleCondition.PRESSURES_LOST)
        by_place = np.zeros((len(deviation), len(deviation)))
        if estimated:
            load = float(self._histories.filter.x[MASS])
            by_place = self._mechanics.slopes(motion, load) * deviation
        window = Balanced(
            duration,
            balance,
            (slowest > self._standing) | (fastest < -self._standing),
            np.maximum(-slowest, fastest) < self._standing,
            fastest > 0.0,
            np.exp(-np.abs(motion.velocity) / (CRAWLING * self._standing)),
            by_place,
        )
        changed = self._histories.add(end, window)
        self._weighed_until = end
        self._moved = 0.0 if changed else self._moved + HOP * bool(window.moving.any())
        condition = ScaleCondition.GOOD
        if window.standing.all():
            condition = ScaleCondition.AT_REST
        if estimated:
            condition = ScaleCondition.POSITIONS_ESTIMATED
        if attainable(self._histories.filter, window) > WORST:
            condition = ScaleCondition.UNOBSERVABLE
        return self._told(end, condition, changed)

    def _motion(self, end: float) -> tuple[MeanMotion, Array, Array]:
        """Also (2, j) least and largest speeds within the window, and (j,) standard deviations of
        the positions; 0 where encoders measure them.
        """
        j = len(self._standing)
        begin = end - WINDOW
        q, v, a = means(*self.encoders.held, begin, end)
        p = means(*self.pressures.held, begin, end)[0]
        speeds, deviation = slowest_and_fastest(*self.encoders.held, begin, end), np.zeros(j)
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

    def _told(self, end: float, condition: ScaleCondition, changed: bool = False) -> Weighing:
        load = self._histories.load
        load = load._replace(deviation=TOLD * load.deviation)
        return Weighing(end, load, condition, changed, self._histories.since, self._moved)


# The scale over a recording: the same numbers as while it was made.


def weigh(scale: Scale, recording: HeardRecording, tared: float = np.nan) -> list[Weighing]:
    """Feed it the recording; tare at `tared` [s], NaN: never."""
    found: list[Weighing] = []
    for kind, k in recording.events():
        if kind == ENCODERS:
            scale.add_encoders(float(recording.encoder_time[k]), recording.encoders[k])
        elif kind == PRESSURES:
            time = float(recording.pressure_time[k])
            if time >= tared:
                scale.tare()
                tared = np.nan
            found += scale.add_pressures(time, recording.chamber_a[k], recording.chamber_b[k])
    return found


# A log of lifts: what was picked up, when it went, and how heavy it was.

LIGHTEST = 5.0  # kg, below which nothing was lifted
SURE = 3.0  # standard deviations, by which a load is more than nothing
KEPT = 100  # weighings of a lift, before the unneeded are forgotten
HEADINGS = (
    "picked_up [s]", "released [s]", "moved [s]", "load [kg]", "std_dev [kg]", "centre [m]",
    "centre.std_dev [m]",
)  # fmt: skip
UNWEIGHED = (
    ScaleCondition.WAITING, ScaleCondition.PRESSURES_LOST, ScaleCondition.POSITIONS_LOST,
    ScaleCondition.UNOBSERVABLE,
)  # fmt: skip


class Lift(NamedTuple):
    """One load from its pick-up to its release, or to the end of what was heard."""

    picked_up: float  # s; of the first weighing, where it hung there from the beginning
    released: float  # s
    moved: float  # s of motion in which it was weighed
    load: TipLoad  # as it was known best


def lifts(weighings: Sequence[Weighing]) -> list[Lift]:
    """Those among weighings in their order."""
    parts: list[list[Weighing]] = [[]]
    for one in weighings:
        if one.changed and parts[-1]:
            parts.append([])
        parts[-1].append(one)
    found = (lift_of(part, weighings[0].time) for part in parts if part)
    return [one for one in found if one is not None]


def lift_of(part: Sequence[Weighing], first: float) -> Lift | None:
    """What hung there in weighings between two changes, if anything did; `first` [s]: when it was
    weighed at all for the first time.
    """
    told = [one for one in part if one.condition not in UNWEIGHED]
    if not told:
        return None
    best = min(told, key=lambda one: one.load.deviation)
    if best.load.mass <= max(LIGHTEST, SURE * best.load.deviation):
        return None
    return Lift(max(best.since, first), part[-1].time, max(one.moved for one in told), best.load)


def row_of(lift: Lift, zero: float = 0.0) -> list[str]:
    """Cells below `HEADINGS`; times since `zero` [s] before those of the lift."""
    times = (f"{zero + one:.3f}" for one in (lift.picked_up, lift.released))
    return [*times, *(f"{value:.6g}" for value in (lift.moved, *lift.load))]


class LiftLog:
    """Lifts as they end, from weighings as they come; it remembers the best of each alone."""

    def __init__(self) -> None:
        self._first: float | None = None
        self._part: list[Weighing] = []

    def add(self, one: Weighing) -> Lift | None:
        """The lift that has ended by this weighing."""
        if self._first is None:
            self._first = one.time
        ended = None
        if one.changed:
            ended = lift_of(self._part, self._first)
            self._part = []
        self._part.append(one)
        if len(self._part) > KEPT:
            self._part = self._shortened(self._part)
        return ended

    def end(self) -> Lift | None:
        """The lift that hangs there still."""
        return lift_of(self._part, self._first or 0.0)

    def _shortened(self, part: list[Weighing]) -> list[Weighing]:
        """What `lift_of` looks at: the best, the longest moved and the last."""
        told = [one for one in part if one.condition not in UNWEIGHED]
        if not told:
            return part[-1:]
        best = min(told, key=lambda one: one.load.deviation)
        moved = max(told, key=lambda one: one.moved)
        return [best, moved, part[-1]]
