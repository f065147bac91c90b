"""Motions of a case: designed ones, and those of the field, band-limited and random."""

from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from crane_model.errors import RangeError
from crane_model.machine import Machine, load_machine
from crane_trajectory.motion.check import Clearance, TipClearance, pump_flow
from crane_trajectory.motion.motion import Motion, plan
from crane_trajectory.motion.periodic import (
    FourierTrajectory,
    JointCourse,
    MotionSamples,
    PeriodicTrajectory,
    Probe,
    SweepTrajectory,
)

# The joints of the laboratory crane that the benchmark is about: their pressures are measured.

LABORATORY_CRANE = load_machine()
PLANAR_JOINTS = LABORATORY_CRANE.as_planar().joints
PLANAR = [LABORATORY_CRANE.index(joint) for joint in PLANAR_JOINTS]


MOTION_HARMONICS = 4
MOTION_ATTEMPTS = 200
SHRINK = 0.85  # of a motion that does not fit, before it is tried again
TRIES = 8  # to shrink it, before another is drawn
FREE_SHARE = 0.05  # of the range of a joint, at both ends
LOOKS = 50  # instants of a motion at which it is looked at before it is planned
DWELL = (0.4, 5.0)  # s, rests of very different length
BAND = (0.12, 0.4)  # Hz, up to which a motion of the field goes
PERIOD_RANGE_S = (9.0, 20.0)  # s, the period of one that repeats
LENGTH_RANGE_S = (40.0, 65.0)  # s, the length of one that does not
CUT_RATIO = 1.4  # of its length, the period of the series that it is cut from


class Richness(StrEnum):
    """How well a case is excited."""

    RICH = "rich"
    POOR = "poor"  # one short, slow, small motion


@dataclass(frozen=True)
class Stretch:
    """Part of a random motion that does not come back to itself within its length."""

    whole: FourierTrajectory
    period: float  # s, its length: of a motion that runs it once

    @property
    def name(self) -> str:
        return self.whole.name

    @property
    def harmonics(self) -> int:
        """Number of harmonics of a series as long as the stretch."""
        return int(np.ceil(self.whole.harmonics * self.period / self.whole.period))

    @property
    def joint_names(self) -> tuple[str, ...]:
        return self.whole.joint_names

    @property
    def probe(self) -> Probe | None:
        return self.whole.probe

    def evaluate(self, time: np.ndarray) -> MotionSamples:
        """Evaluate the whole motion at any time (n,) [s]."""
        return self.whole.evaluate(time)


@dataclass(frozen=True)
class Maker:
    """Draws motions that fit the machine; every one begins at rest in the pose `start` (4,)."""

    rng: np.random.Generator
    machine: Machine
    start: np.ndarray
    clearance: Clearance

    def designed(self, sets: int) -> tuple[list[Motion], list[Motion]]:
        """To train on, `sets` times a slow, a fast one and sweeps; to validate, the first two."""
        train = [
            motion
            for _ in range(sets)
            for motion in (self._periodic(17.0, 3), self._periodic(6.5, 4), self._sweeps())
        ]
        return train, [self._periodic(17.0, 3), self._periodic(6.5, 4)]

    def of_the_field(self, sets: int) -> tuple[list[Motion], list[Motion]]:
        """As many random ones, in any order; every other one repeats itself."""

        def several(count: int) -> list[Motion]:
            made = [self._repeated() if k % 2 else self._stretch() for k in range(count)]
            return [made[k] for k in self.rng.permutation(count)]

        return several(3 * sets), several(2)

    def poor(self) -> tuple[list[Motion], list[Motion]]:
        """One short, slow, small motion each."""
        return [self._periodic(16.0, 1, 0.08)], [self._periodic(16.0, 1, 0.08)]

    def _periodic(self, period: float, periods: int, size: float = 0.9) -> Motion:
        drawn = round(period * self.rng.uniform(0.9, 1.1), 2)
        return self._fitting(
            lambda share: _fourier(self.rng, self.machine, drawn, size * share), periods
        )

    def _sweeps(self) -> Motion:
        drawn = round(self.rng.uniform(18.0, 22.0), 2)
        return self._fitting(lambda share: _sweeps(self.rng, self.machine, drawn, 0.9 * share), 2)

    def _repeated(self) -> Motion:
        period, band = round(self.rng.uniform(*PERIOD_RANGE_S), 2), self.rng.uniform(*BAND)
        harmonics = max(round(band * period), 2)
        return self._fitting(
            lambda share: _fourier(self.rng, self.machine, period, 0.9 * share, harmonics), 3
        )

    def _stretch(self) -> Motion:
        length, band = round(self.rng.uniform(*LENGTH_RANGE_S), 2), self.rng.uniform(*BAND)
        period = round(CUT_RATIO * length, 2)
        harmonics = round(band * period)

        def draw(share: float) -> Stretch:
            return Stretch(_fourier(self.rng, self.machine, period, 0.9 * share, harmonics), length)

        return self._fitting(draw, 1)

    def _fitting(self, draw: Callable[[float], PeriodicTrajectory], periods: int) -> Motion:
        for _ in range(MOTION_ATTEMPTS):
            state = self.rng.bit_generator.state
            for attempt in range(TRIES):
                self.rng.bit_generator.state = state
                trajectory = draw(SHRINK**attempt)
                if not _has_clearance(self.machine, self.clearance, trajectory):
                    continue
                try:
                    return plan(self.machine, trajectory, self.start, periods, self.clearance)
                except RangeError:
                    continue
        raise RangeError(
            f"none of {MOTION_ATTEMPTS} motions fits the machine, each tried in {TRIES} sizes down "
            f"to {SHRINK ** (TRIES - 1):.0%}; ask for slower or smaller ones"
        )


def _has_clearance(machine: Machine, clearance: Clearance, trajectory: PeriodicTrajectory) -> bool:
    """Return whether tip and pump allow it at some instants: a quick form of `plan`."""
    joints = trajectory.joint_names
    samples = trajectory.evaluate(np.linspace(0.0, trajectory.period, LOOKS))
    tip_clearance = TipClearance(machine).at(joints, samples.position)
    flow = pump_flow(machine, joints, samples.position, samples.velocity)
    return bool(
        (tip_clearance > clearance.kept).all() and (flow < machine.hydraulics.pump_flow).all()
    )


def _fourier(
    rng: np.random.Generator,
    machine: Machine,
    period: float,
    size: float,
    harmonics: int = MOTION_HARMONICS,
) -> FourierTrajectory:
    """Random series of even speed; `size` is its share of range or speed, whichever is less."""
    time = np.linspace(0.0, period, 20 * harmonics, endpoint=False)
    columns = []
    for joint in PLANAR_JOINTS:
        coefficients = rng.standard_normal(2 * harmonics) / np.tile(np.arange(1, harmonics + 1), 2)
        shape = FourierTrajectory.from_coefficients(
            "", period, (joint,), np.append(0.0, coefficients)[:, np.newaxis]
        ).evaluate(time)
        limits = machine.limits[joint]
        span = (1.0 - 2.0 * FREE_SHARE) * (limits.position_max - limits.position_min)
        fastest = limits.slower_speed
        factor = size * min(span / np.ptp(shape.position), fastest / np.abs(shape.velocity).max())
        low, high = factor * shape.position.min(), factor * shape.position.max()
        free = FREE_SHARE * (limits.position_max - limits.position_min)
        offset = rng.uniform(limits.position_min + free - low, limits.position_max - free - high)
        columns.append(np.append(offset, factor * coefficients))
    return FourierTrajectory.from_coefficients(
        "excitation", period, PLANAR_JOINTS, np.round(np.stack(columns, axis=1), 6)
    )


def _sweeps(
    rng: np.random.Generator, machine: Machine, period: float, size: float
) -> SweepTrajectory:
    """All joints at once, each up and down at its own constant speeds, with a dwell at each end."""
    courses = {}
    for joint in PLANAR_JOINTS:
        limits = machine.limits[joint]
        dwells = rng.uniform(*DWELL, 2)
        up = rng.uniform(0.35, 0.65) * (period - dwells.sum())
        times = np.cumsum([0.0, up, dwells[0], period - dwells.sum() - up, dwells[1]])
        times[-1] = period
        fastest = limits.slower_speed
        span = (1.0 - 2.0 * FREE_SHARE) * (limits.position_max - limits.position_min)
        way = size * min(span, fastest * min(up, times[3] - times[2]))
        free = FREE_SHARE * (limits.position_max - limits.position_min)
        low = rng.uniform(limits.position_min + free, limits.position_max - free - way)
        ends = [low, low + way] if rng.uniform() < 0.5 else [low + way, low]
        positions = np.round([ends[0], ends[1], ends[1], ends[0], ends[0]], 6)
        courses[joint] = JointCourse(
            time=tuple(np.round(times, 6).tolist()), position=tuple(positions.tolist())
        )
    return SweepTrajectory(kind="sweep", name="sweeps", period=period, corner=0.5, joints=courses)
