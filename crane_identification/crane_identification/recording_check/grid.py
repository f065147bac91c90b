"""A recording on one coarse time base, smooth enough for a check."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy import signal
from scipy.ndimage import binary_erosion

from crane_identification.data.log import Log
from crane_identification.data.resample import resample
from crane_identification.recording_check.suspicion import (
    BANDWIDTH,
    LEAST_MOTION,
    MOVING,
    SETTLING,
    WORKING_RATE,
)
from crane_model.cylinders import lever_arms
from crane_model.errors import DataError
from crane_model.machine import Machine
from crane_model.record import Record

ORDER = 4
PADDING = 3 * ORDER


@dataclass(frozen=True)
class Grid:
    """n samples of j joints every `step` s: the longest run of a recording without gaps.

    `record` holds motion, and pressures and command where logged, all with one smooth low-pass;
    `force` (n, j) is the generalized force where that, not pressures, was logged. Supply and tank
    are those of the machine where they were not logged.
    """

    machine: Machine
    record: Record
    force: np.ndarray | None
    step: float

    @property
    def joints(self) -> tuple[str, ...]:
        """Names of the columns."""
        return self.record.joints

    @cached_property
    def moving(self) -> np.ndarray:
        """(n, j) where friction has one sign, and has settled."""
        limits = [self.machine.limits[joint] for joint in self.joints]
        slowest = MOVING * np.array([min(one.velocity_max, -one.velocity_min) for one in limits])
        moves = np.abs(self.record.velocity) > slowest
        around = max(1, round(SETTLING / self.step))
        return np.stack([binary_erosion(one, iterations=around) for one in moves.T], axis=1)

    @cached_property
    def arms(self) -> np.ndarray:
        """(n, j) lever arms; `RangeError` where a linkage cannot be assembled."""
        return lever_arms(self.machine, self.record.position, self.joints)

    @cached_property
    def pistons(self) -> np.ndarray:
        """(n, j) cylinder forces (19), or generalized forces where those were logged."""
        if self.force is not None:
            return self.force
        record, cylinders = self.record, [self.machine.cylinders[joint] for joint in self.joints]
        area_a = np.array([one.area_a for one in cylinders])
        area_b = np.array([one.area_b for one in cylinders])
        return area_a * record.pressure_a - area_b * record.pressure_b

    def generalized(self, pistons: np.ndarray) -> np.ndarray:
        """(n, j) generalized forces (27) of `pistons`."""
        return pistons if self.force is not None else self.arms * pistons


def grid(machine: Machine, log: Log, joints: tuple[str, ...]) -> Grid:
    """The joints `joints` of a log; `DataError` if they hardly move, or are not logged together."""
    samples = resample(log)
    run = np.bincount(samples.run).argmax()
    every = max(1, int(samples.rate / WORKING_RATE))
    step = every / samples.rate
    rows = np.flatnonzero(samples.run == run)
    columns = np.array([log.joints.index(joint) for joint in joints])
    if len(rows) <= PADDING or samples.rate <= 2.0 * BANDWIDTH:
        raise DataError(f"{len(rows)} samples at {samples.rate:.3g} Hz are too few")
    sections = signal.butter(ORDER, BANDWIDTH, fs=samples.rate, output="sos")

    def smooth(values: np.ndarray | None) -> np.ndarray | None:
        if values is None or not np.isfinite(values[rows]).all():
            return None
        kept = values[rows] if values.ndim == 1 else values[np.ix_(rows, columns)]
        return signal.sosfiltfilt(sections, kept, axis=0, padlen=PADDING)[::every]

    def constant(values: np.ndarray | None, stated: float) -> np.ndarray:
        found = smooth(values)
        return np.full(len(time), stated) if found is None else found

    time = samples.time[rows][::every]
    position = smooth(samples.position)
    assert position is not None  # resample leaves no NaN
    velocity = np.gradient(position, step, axis=0)
    hydraulics = machine.hydraulics
    whole = Grid(
        machine,
        Record(
            joints=joints,
            time=time,
            position=position,
            velocity=velocity,
            acceleration=np.gradient(velocity, step, axis=0),
            pressure_a=smooth(samples.pressure_a),
            pressure_b=smooth(samples.pressure_b),
            command=smooth(_closed_before(samples.command)),
            supply_pressure=constant(samples.supply_pressure, hydraulics.supply_pressure),
            tank_pressure=constant(samples.tank_pressure, hydraulics.tank_pressure),
        ),
        smooth(samples.force),
        step,
    )
    seconds = dict(zip(joints, whole.moving.sum(axis=0) * step, strict=True))
    lazy = [f"{joint} {time:.1f} s" for joint, time in seconds.items() if time < LEAST_MOTION]
    if lazy:
        raise DataError(f"{LEAST_MOTION:g} s of motion needed, got of {', '.join(lazy)}")
    return whole


def _closed_before(command: np.ndarray | None) -> np.ndarray | None:
    """(n, j) with valves closed where no command was logged yet, if any was."""
    return None if command is None or np.isnan(command).all() else np.nan_to_num(command)
