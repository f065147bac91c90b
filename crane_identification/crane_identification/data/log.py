"""A log: raw signals of one recording, each with its own time stamps."""

import math
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np

from crane_bags.clocks import SetBack
from crane_model.errors import DataError


@dataclass(frozen=True)
class Signal:
    """Samples of quantities that were measured together: `time` (n,) [s] strictly increasing,
    `value` (n,) or (n, j) in SI units, NaN where nothing was measured; `origin` is the topic or
    the columns that they come from. `received` (n,) [s]: when the recorder received each sample,
    counted like `time` but on the clock of the recorder; None where that is not known. `set_back`:
    how time went back in the order of arrival, before the samples were sorted. `columns`: where
    each column comes from, if not all from `origin`. `resolution` (j,): of the sensors, if the
    values were filtered; None: it shows in the values.
    """

    time: np.ndarray
    value: np.ndarray
    origin: str
    received: np.ndarray | None = None
    set_back: SetBack | None = None
    columns: tuple[str, ...] = ()
    resolution: np.ndarray | None = None

    def column(self, j: int) -> str:
        """Where column j comes from."""
        return self.columns[j] if self.columns else self.origin

    def take(self, rows: np.ndarray) -> "Signal":
        """The samples `rows`."""
        received = None if self.received is None else self.received[rows]
        return replace(self, time=self.time[rows], value=self.value[rows], received=received)


@dataclass(frozen=True)
class Log:
    """One recording. Columns of (n, j) signals are in the order of `joints`; None is not logged.

    Time zero is the first position of the recording, `start` [ns] on its clock. `missing` names the
    topics or quantities that are not there, `notes` what had to be mended, `uncalibrated` the
    quantities that are in counts of their sensors instead of SI units, `unstamped` the topics whose
    messages hold no usable stamp, so that the times are those of the recorder.

    >>> time = np.linspace(0.0, 4.0, 5)
    >>> log = Log("made", ("axis",), 0, Signal(time, np.zeros((5, 1)), "made"))
    >>> log.during(1.0, 3.0).position.time
    array([1., 2., 3.])
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
    slew_command: Signal | None = None  # (n,) spool command, alike
    command: Signal | None = None  # (n, j) spool command, -1..1
    reference_position: Signal | None = None  # (n, j) rad or m
    reference_velocity: Signal | None = None  # (n, j) per s
    reference_acceleration: Signal | None = None  # (n, j) per s²
    temperature: Signal | None = None  # (n,) deg C
    missing: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    uncalibrated: tuple[str, ...] = ()
    unstamped: tuple[str, ...] = ()

    @property
    def warnings(self) -> tuple[str, ...]:
        """What a reader of results must know of the recording, in sentences that name it."""
        absent = [f"not recorded: {', '.join(self.missing)}"] if self.missing else []
        return tuple(f"{self.source}: {note}." for note in (*absent, *self.notes))

    def during(self, begin: float, end: float) -> "Log":
        """What was recorded from `begin` to `end` [s]; `DataError` if no position was."""
        if begin <= 0.0 and end >= self.position.time[-1]:
            return self
        parts: dict[str, Any] = {}
        for name in (one.name for one in fields(self)):
            signal = getattr(self, name)
            if isinstance(signal, Signal):
                inside = np.flatnonzero((signal.time >= begin) & (signal.time <= end))
                parts[name] = signal.take(inside) if len(inside) else None
        if parts["position"] is None:
            until = "its end" if math.isinf(end) else f"{end:g} s"
            raise DataError(
                f"{self.source}: no position from {begin:g} s to {until}; it lasts "
                f"{self.position.time[-1]:.4g} s: correct --from and --to"
            )
        return replace(self, **parts)
