"""Single readings: jumps, noise, values that stand still; whatever is known of the machine."""

import math
from collections.abc import Sequence

import numpy as np
from numba import njit
from numpy.typing import NDArray

from crane_model.array import Array, Flags
from crane_model.machine import USUAL_RANGE, Machine
from crane_observer.monitor.blocks import LONGEST_SAMPLE_GAP, Sample
from crane_observer.monitor.finding import COVERED, SUPPLY, Part, SensorFinding, Wrong
from crane_observer.position.flow import FULL_SCALE_SHARE

LOOKED_AT = 60  # samples, 0.3 s at 200 Hz
PINNED = 400  # samples, 2 s: longer than a load that swings keeps a chamber beyond what is shown
LATELY = 12  # samples
USUAL_WEIGHT = 2e-4  # of each sample in what is usual: over 5000 of them
FIRST_SAMPLES = 400  # before anything is usual
DIFFERENCE = np.array([-4.0, 6.0, -4.0, 1.0])  # of the four readings before, newest first
DIFFERENCE_GAIN = 70.0**0.5  # of the fourth difference, for white noise
MEDIAN = 0.6745  # standard deviations
NOISIER = 4.0  # times what is usual
NOISE_INTERVAL = (0.7, 1.3)  # of a noise, 95 %

NEIGHBOURS = 6  # steps before and behind one, that tell how fast the joint moves
JUMP_SIZE = 5.0  # times what the largest of them is off
ROUNDING = 12.0**-0.5  # of a step, standard deviation of rounding
NUMERIC_ZERO = 1e-9  # rad, m: what numbers round
READING_GAP = 0.1  # s between two readings, behind which all begins anew
JUMP_STEPS = 8.0  # of the encoder, at least

OPEN_COMMAND = 0.3  # of the largest command, beyond the dead bands of all valves
SUPPLY_LEFT = 1e6  # Pa of the supply above either chamber
STANDS_FOR = 0.3  # s


class ReadingHabits:
    """Repetition and roughness of the readings of s sensors.

    Roughness is the fourth difference, which a smooth motion hardly has. The usual values are
    learnt while nothing is wrong. Readings are taken as they were read: between two of them lies no
    step of the converter, and none of its noise.
    """

    def __init__(self, sensors: int, full: float = np.inf):
        """From `full` on, a sensor is at the end of what it can show."""
        self._full = full
        self._last = np.full((len(DIFFERENCE), sensors), np.nan)
        self._rough = np.full((LOOKED_AT, sensors), np.nan)
        self._same = np.zeros(sensors, dtype=np.int64)
        self._usual_rough, self._step = np.zeros((2, sensors))
        self._count = 0

    def add(self, shown: Array) -> None:
        """Readings (s,) of one time; those with something that is no number do not count."""
        self._count += _note(
            shown, self._count, self._last, self._rough, self._same, self._usual_rough, self._step,
        )  # fmt: skip

    @property
    def stuck(self) -> Flags:
        """(s,) whether a flickering sensor has shown one value for LOOKED_AT, or PINNED."""
        wanted = np.where(self._last[0] < self._full, LOOKED_AT, PINNED)
        return np.asarray((self._count > FIRST_SAMPLES) & (self.repeated >= wanted))

    @property
    def repeated(self) -> Array:
        """(s,) how many times the last reading was repeated; 0 of a sensor that does not flicker: a
        step of its converter hides its noise, and a reading that stands says nothing.
        """
        flickers = (self._step > 0.0) & (self._usual_rough > ROUNDING * self._step)
        return np.where(flickers, self._same, 0.0)

    @property
    def noise(self) -> Array:
        """(s,) how rough the last LOOKED_AT samples were, in units of the sensor; NaN at first."""
        if self._count < LOOKED_AT + 4:
            return np.full(self._last.shape[1], np.nan)
        return np.asarray(np.median(self._rough, axis=0)) / MEDIAN

    @property
    def noisy(self) -> Flags:
        """(s,) whether that is a multiple of what is usual, and of what rounding makes."""
        return self._beyond(NOISIER, self._rough)

    @property
    def noisy_now(self) -> Flags:
        """(s,) the same of the last LATELY samples alone: no proof, but a hint when others ask."""
        rows = (self._count - 1 - np.arange(LATELY)) % LOOKED_AT
        return self._beyond(0.75 * NOISIER, self._rough[rows])

    def _beyond(self, times: float, rough: Array) -> Flags:
        usual = np.maximum(self._usual_rough, self._step)
        if self._count < FIRST_SAMPLES:
            return np.zeros(len(usual), dtype=bool)
        return np.asarray(np.median(rough, axis=0) / MEDIAN > times * usual)


@njit(cache=True, error_model="numpy")
def _note(
    shown: Array, count: int, last: Array, roughness: Array, same: NDArray[np.int64],
    usual_rough: Array, step: Array,
) -> int:  # fmt: skip
    """Take readings (s,) behind `count` others; return 0 if they do not count, else 1."""
    for value in shown:
        if not math.isfinite(value):
            return 0
    for i in range(len(shown)):
        if count > 3:
            rough = shown[i]
            for k in range(len(DIFFERENCE)):
                rough += DIFFERENCE[k] * last[k, i]
            rough = abs(rough) / DIFFERENCE_GAIN
            change = abs(shown[i] - last[0, i])
            changed = change > 0.0
            same[i] = 0 if changed else same[i] + 1
            if changed and (change < step[i] or step[i] == 0.0):
                step[i] = change
            roughness[count % LOOKED_AT, i] = rough
            weight = max(USUAL_WEIGHT, 1.0 / count)
            if count >= FIRST_SAMPLES:
                rough = min(rough, NOISIER * usual_rough[i] + step[i])
            usual_rough[i] += weight * (rough - usual_rough[i])
        for k in range(len(DIFFERENCE) - 1, 0, -1):
            last[k, i] = last[k - 1, i]
        last[0, i] = shown[i]
    return 1


class JumpWatch:
    """Encoders that jump: one step between two readings that no piston can have gone.

    A step is judged once as many have come behind it as are looked at before it: noise, and a stamp
    or a reading that is late, show in their neighbours, too.
    """

    def __init__(self, sensors: int):
        self._time = np.full(2 * NEIGHBOURS + 2, -np.inf)
        self._shown = np.full((2 * NEIGHBOURS + 2, sensors), np.nan)
        self._step = np.full(sensors, np.inf)
        self.size = np.zeros(sensors)  # (s,) rad, m: the last jump since `forget`; 0: none
        self.deviation = np.zeros(sensors)  # (s,) of the size
        self.at = np.zeros(sensors)  # (s,) s

    def forget(self) -> None:
        self.size[:] = 0.0

    def add(self, time: float, shown: Array) -> None:
        """Readings (s,) of one time [s]; those that are NaN, or of no later time, do not count."""
        if not np.isfinite(shown).all() or time <= self._time[-1]:
            return
        if time - self._time[-1] > READING_GAP:
            self._shown[:] = np.nan
        self._time[:-1], self._shown[:-1] = self._time[1:], self._shown[1:]
        self._time[-1], self._shown[-1] = time, shown
        _judge(self._time, self._shown, self._step, self.size, self.deviation, self.at)


@njit(cache=True, error_model="numpy")
def _judge(
    time: Array, shown: Array, least: Array, size: Array, deviation: Array, at: Array
) -> None:
    """Judge the middle step of readings (n, s); `least` (s,) is the encoders' resolution."""
    lasting = time[1:] - time[:-1]
    for i in range(shown.shape[1]):
        steps = shown[1:, i] - shown[:-1, i]
        more = abs(steps[-1] - steps[-2])
        if NUMERIC_ZERO < more < least[i]:
            least[i] = more
        if not np.isfinite(steps[0]):
            continue
        off = steps - lasting * np.median(steps / lasting)
        jump, beside = off[NEIGHBOURS], np.abs(np.delete(off, NEIGHBOURS))
        stays = 0.5 < np.sum(off) / jump < 1.5  # what a stamp does, its neighbours take back
        if stays and abs(jump) > max(JUMP_SIZE * beside.max(), JUMP_STEPS * least[i]):
            size[i] = jump
            deviation[i] = max(np.sqrt(np.mean(beside**2)), least[i] * ROUNDING)
            at[i] = time[NEIGHBOURS + 1]


class StandingWatch:
    """Joints that stand though oil must flow: a stuck encoder or valve where no flow is known.

    A valve that is open passes oil as long as the supply is above the pressures of both chambers,
    and the piston goes; against a stop, or a load that is too heavy, the chamber that is fed comes
    up to the supply. So either the encoder does not show the motion, or the valve does not open.
    """

    def __init__(self, joints: int):
        self._shown = np.full(joints, np.nan)
        self._time = -np.inf
        self.since = np.full(joints, np.inf)  # (j,) s, from when each stands so

    def add(self, sample: Sample, command: Array) -> None:
        """While `command` (j,) -1..1 is in force; behind a gap all begins anew."""
        left = sample.supply - np.maximum(sample.chamber_a, sample.chamber_b)
        stands = sample.position == self._shown
        stands &= (np.abs(command) > OPEN_COMMAND) & (left > SUPPLY_LEFT)
        stands &= sample.time - self._time < LONGEST_SAMPLE_GAP
        self.since = np.where(stands, np.minimum(self.since, self._time), np.inf)
        self._time, self._shown = sample.time, sample.position

    @property
    def standing(self) -> Flags:
        """(j,) whether each has stood so for long enough."""
        return np.asarray(self._time - self.since > STANDS_FOR)


class ReadingWatch:
    """Watch of encoders, chambers A and B of j joints, and the supply, in this order."""

    def __init__(self, joints: Sequence[str], units: Sequence[str], machine: Machine | None):
        """`units` (j,) of the encoders: rad or m."""
        parts = (Part.ENCODER, Part.PRESSURE_A, Part.PRESSURE_B)
        self.sensors = [(part, joint) for part in parts for joint in joints]
        self.sensors.append((Part.SUPPLY, SUPPLY))
        self._units, count = tuple(units), len(joints)
        supply = machine.hydraulics if machine else None
        full = FULL_SCALE_SHARE * (supply.transducer_range if supply else USUAL_RANGE)
        self._follows_load = bool(supply and supply.load_sensing)
        self._encoders = ReadingHabits(count)
        self._chambers, self._supply = ReadingHabits(2 * count, full), ReadingHabits(1, full)
        self._jumps = JumpWatch(count)
        self._period, self._last = 0.0, 0.0

    def read_encoders(self, time: float, position: Array) -> None:
        """(j,) as they were read [s]: between two readings there is no noise to be seen."""
        self._encoders.add(position)
        self._jumps.add(time, position)

    def read_pressures(
        self, time: float, chamber_a: Array, chamber_b: Array, supply: float
    ) -> None:
        """(j,) (j,) Pa, and the supply, as they were read [s]."""
        self._chambers.add(np.concatenate([chamber_a, chamber_b]))
        self._supply.add(np.array([supply]))
        self._period, self._last = time - self._last, time

    def _of_all(self, habit: str) -> np.ndarray:
        habits = (self._encoders, self._chambers, self._supply)
        return np.concatenate([getattr(sensors, habit) for sensors in habits])

    @property
    def noisy_now(self) -> Flags:
        noisy = self._of_all("noisy_now")
        noisy[-1] &= not self._follows_load
        return noisy

    @property
    def repeated(self) -> Array:
        """(s,) how many times the last reading was repeated."""
        return self._of_all("repeated")

    def found(self, time: float) -> list[SensorFinding]:
        stuck, noisy = self._of_all("stuck"), self._of_all("noisy")
        if self._follows_load:  # the loads shake the supply, whose own noise is not known
            stuck[-1] = noisy[-1] = False
        found = self._jumped(time)
        for k, (part, _) in enumerate(self.sensors):
            frozen = bool(stuck[k]) and part is not Part.ENCODER  # at rest an encoder is quiet
            if frozen or noisy[k]:
                found.append(self.noise(k, time, frozen))
        return found

    def noise(self, sensor: int, time: float, frozen: bool = False) -> SensorFinding:
        """The finding that a sensor is noisy, or `frozen`."""
        part, joint = self.sensors[sensor]
        size = float(self._of_all("noise")[sensor])
        unit = self._units[sensor] if part is Part.ENCODER else "Pa"
        kind, unit = (Wrong.STUCK, "") if frozen else (Wrong.NOISE, unit)
        low, high = (share * size for share in NOISE_INTERVAL)
        begun = time - LOOKED_AT * self._period
        return SensorFinding(part, joint, kind, unit, size, low, high, begun, time)

    def _jumped(self, time: float) -> list[SensorFinding]:
        found, jumps = [], self._jumps
        for j in np.flatnonzero(jumps.size).tolist():
            part, joint = self.sensors[j]
            size, spread = float(jumps.size[j]), COVERED * float(jumps.deviation[j])
            interval = size, size - spread, size + spread
            at = float(jumps.at[j])
            found.append(
                SensorFinding(part, joint, Wrong.JUMP, self._units[j], *interval, at, time)
            )
        jumps.forget()
        return found
