"""A log: raw signals of one recording, each with its own time stamps."""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Signal:
    """Samples of quantities that were measured together: `time` (n,) [s] strictly increasing,
    `value` (n,) or (n, j) in SI units, NaN where nothing was measured; `origin` is the topic or
    the columns that they come from. `received` (n,) [s]: when the recorder received each sample,
    counted like `time` but on the clock of the recorder; None where that is not known.
    """

    time: np.ndarray
    value: np.ndarray
    origin: str
    received: np.ndarray | None = None


@dataclass(frozen=True)
class Log:
    """One recording. Columns of (n, j) signals are in the order of `joints`; None is not logged.

    Time zero is the first position, `start` [ns] on the clock of the recording. `missing` names
    the topics or quantities that are not there, `notes` what had to be mended, `uncalibrated` the
    quantities that are in counts of their sensors instead of SI units.
    """

    source: str
    joints: tuple[str, ...]
    start: int
    position: Signal  # (n, j) rad or m
    velocity: Signal | None = None  # (n, j) as logged, per s
    force: Signal | None = None  # (n, j) generalized force, N m or N
    pressure_a: Signal | None = None  # (n, j) Pa gauge
    pressure_b: Signal | None = None  # (n, j) Pa gauge
    supply_pressure: Signal | None = None  # (n,) Pa gauge
    tank_pressure: Signal | None = None  # (n,) Pa gauge
    slew_position: Signal | None = None  # (n,) rad, where slew is not one of the joints
    command: Signal | None = None  # (n, j) spool command, -1..1
    reference_position: Signal | None = None  # (n, j) rad or m
    reference_velocity: Signal | None = None  # (n, j) per s
    reference_acceleration: Signal | None = None  # (n, j) per s²
    temperature: Signal | None = None  # (n,) deg C
    missing: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    uncalibrated: tuple[str, ...] = ()
