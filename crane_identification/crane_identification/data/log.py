"""A log: raw signals of one recording, each with its own time stamps."""

import math
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np

from crane_bags.clocks import SetBack
from crane_model.errors import DataError


@dataclass(frozen=True)
class Signal:
    """Samples of quantities that were measured together.

    Parameters
    ----------
    time : ndarray, shape (n,)
        Stamps [s], strictly increasing.
    value : ndarray, shape (n,) or (n, j)
        Values in SI units; NaN where nothing was measured.
    origin : str
        Topic or columns that the samples come from.
    received : ndarray, shape (n,), optional
        Times of reception on the recorder's clock [s], counted like `time`; None: not known.
    set_back : SetBack, optional
        How time went back in the order of arrival, before the samples were sorted.
    columns : tuple of str
        Origin of each column, if not all come from `origin`.
    resolution : ndarray, shape (j,), optional
        Resolution of the sensors if the values were filtered; None: it shows in the values.
    latency : ndarray, shape (j,), optional
        By which the values are older than their stamps [s]; None: they are not.

    Examples
    --------
    >>> time = np.linspace(0.0, 1.0, 3)
    >>> Signal(time, time[:, np.newaxis], "made").column(0)
    'made'
    """

    time: np.ndarray
    value: np.ndarray
    origin: str
    received: np.ndarray | None = None
    set_back: SetBack | None = None
    columns: tuple[str, ...] = ()
    resolution: np.ndarray | None = None
    latency: np.ndarray | None = None

    def seen(self, j: int) -> np.ndarray:
        """Return the times (n,) [s] at which the machine was as column `j` shows it."""
        return self.time if self.latency is None else self.time - self.latency[j]

    def column(self, j: int) -> str:
        """Return the origin of column `j`."""
        return self.columns[j] if self.columns else self.origin

    def take(self, rows: np.ndarray) -> "Signal":
        """Return the samples at the indices `rows` (k,)."""
        received = None if self.received is None else self.received[rows]
        return replace(self, time=self.time[rows], value=self.value[rows], received=received)


@dataclass(frozen=True)
class Log:
    """Signals of one recording, as they were logged.

    Columns of signals (n, j) are in the order of `joints`; a signal that was not logged is None.
    Time zero is the first position of the recording.

    Parameters
    ----------
    source : str
        Name of the recording.
    joints : tuple of str
        Names of the j joints.
    start : int
        Stamp of time zero on the clock of the recording [ns].
    position : Signal
        Positions (n, j) [rad or m]. The unit of each other signal stands beside its field.
    missing : tuple of str
        Topics or quantities that the recording lacks.
    notes : tuple of str
        Repairs that were made when the recording was read.
    uncalibrated : tuple of str
        Quantities in counts of their sensors instead of SI units.
    unstamped : tuple of str
        Topics without usable stamps, whose times are those of the recorder.

    Examples
    --------
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
    slew_command: Signal | None = None  # (n,) valve command, -1..1
    command: Signal | None = None  # (n, j) valve command, -1..1
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
        """Limitations of the recording that results depend on, as sentences."""
        absent = [f"not recorded: {', '.join(self.missing)}"] if self.missing else []
        return tuple(f"{self.source}: {note}." for note in (*absent, *self.notes))

    def during(self, begin: float, end: float) -> "Log":
        """Return the part from `begin` to `end` [s]; `DataError` if it holds no position."""
        if begin <= 0.0 and end >= self.position.time[-1]:
            return self
        parts: dict[str, Any] = {}
        for name in (field.name for field in fields(self)):
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
