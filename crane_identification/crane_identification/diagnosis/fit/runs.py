"""Gapless runs, and how their samples become rows: zones, low-pass and decimation.

A linear filter on both sides of (28) leaves Theta as it is. With a finite response only the rows
that are kept cost anything, which counts with hundreds of columns.
"""

from dataclasses import dataclass
from enum import Enum
from functools import cache, cached_property
from typing import NamedTuple

import numpy as np
from numba import njit
from scipy import ndimage, signal

from crane_identification.estimation.regression import OPEN
from crane_identification.preparation.run import Preparation
from crane_identification.signals.decimate import PASS_BAND, decimation_rows
from crane_model.record import Record

OPEN_TURNING = 0.15
"""As `OPEN` close to reversals, which are shorter than what the filter sees."""
CYCLES = 12  # length of the response, in rows that are kept
STOP_BAND = 6.0  # shape of the Kaiser window: 60 dB


class Zone(Enum):
    """Which samples of a joint are asked."""

    MOVING = "while it moves"
    TURNING = "close to reversals"

    def gate(self, preparation: Preparation) -> np.ndarray:
        """(samples, j): 1.0 within the zone."""
        if self is Zone.MOVING:
            return preparation.moving.astype(float)
        return (preparation.signed & ~preparation.moving).astype(float)

    @property
    def open(self) -> float:
        """Share of what the filter sees that must be within the zone, for a row to be used."""
        return OPEN if self is Zone.MOVING else OPEN_TURNING


@dataclass(frozen=True)
class Run:
    """One gapless run: its record, which samples its channels see, and how many make a row."""

    source: str
    number: int
    record: Record
    gate: np.ndarray  # (samples, channels)
    factor: int

    @property
    def kept(self) -> np.ndarray:
        """Samples that become rows."""
        return decimation_rows(len(self.record), self.factor)

    @cached_property
    def seen(self) -> np.ndarray:
        """(samples, j): 1.0 where a channel of the joint sees it."""
        joints = self.record.position.shape[1]
        return (self.gate.reshape(len(self.gate), -1, joints) > 0.0).any(axis=1).astype(float)

    def reached(self, flags: np.ndarray) -> np.ndarray:
        """(n, ...): whether the filter of a row reaches a sample with a flag (samples, ...)."""
        size = 1 if self.factor == 1 else CYCLES * self.factor + 1
        return ndimage.maximum_filter1d(flags.astype(np.uint8), size, axis=0)[self.kept] > 0

    @cached_property
    def _open(self) -> "_Open":
        return _opened(self.gate, self.factor)

    def filtered(self, columns: np.ndarray) -> np.ndarray:
        """(samples, j, k) to gated rows (n, channels, k); columns of zeros cost next to nothing."""
        if self.factor == 1:
            zones = self.gate.shape[1] // columns.shape[1]
            return np.tile(columns, (1, zones, 1)) * self.gate[..., np.newaxis]
        return _gated(columns, self._open, _response(self.factor))


def thinned(values: np.ndarray, factor: int) -> np.ndarray:
    """Values (n, ...) at `decimation_rows`, filtered with zero phase; zero beyond the ends."""
    if factor == 1:
        return values
    flat = values.reshape(len(values), 1, -1)
    out = _gated(flat, _opened(np.ones((len(values), 1)), factor), _response(factor))
    return out.reshape(len(out), *values.shape[1:])


def row_noise(factor: int) -> float:
    """Standard deviation of a row over that of samples whose noise is white."""
    return 1.0 if factor == 1 else float(np.linalg.norm(_response(factor)))


class _Open(NamedTuple):
    """Where the gates of channels are open: which samples, by how much, and where each goes.

    Sample `factor` m + p of the window of a row lies at (p, m) of `phases` (2,): what one tap sees
    of all `rows` is contiguous. Those of a channel end at `ends` (channels,).
    """

    sample: np.ndarray
    gate: np.ndarray
    place: np.ndarray
    ends: np.ndarray
    phases: tuple[int, int]
    rows: int


def _opened(gate: np.ndarray, factor: int) -> _Open:
    """The samples at which a `gate` (n, channels) is open, channel by channel."""
    taps, kept = len(_response(factor)), decimation_rows(len(gate), factor)
    phases = factor, len(kept) + taps // factor + 1
    first = int(kept[0]) - taps // 2 if len(kept) else 0  # before the first sample there are zeros
    channel, sample = np.nonzero(gate.T)
    later, phase = np.divmod(sample - first, factor)
    ends = np.searchsorted(channel, np.arange(gate.shape[1]), side="right")
    place = phase * phases[1] + later
    return _Open(sample, gate[sample, channel], place, ends, phases, len(kept))


@njit(cache=True)
def _gated(columns: np.ndarray, open_: _Open, response: np.ndarray) -> np.ndarray:
    """(rows, channels, k): columns (n, j, k), j channels in turn, as their gates let them through,
    with a finite response (taps,).
    """
    joints, width = columns.shape[1:]
    out = np.zeros((open_.rows, len(open_.ends), width))
    row, begin = np.empty(open_.rows), 0
    for channel in range(len(open_.ends)):
        end = open_.ends[channel]
        phases = np.zeros(open_.phases)
        flat = phases.ravel()
        for k in range(width):
            acts = False
            for i in range(begin, end):
                x = columns[open_.sample[i], channel % joints, k] * open_.gate[i]
                flat[open_.place[i]] = x
                acts |= x != 0.0
            if acts:
                _seen(phases, response, row)
                out[:, channel, k] = row
        begin = end
    return out


@njit(cache=True)
def _seen(phases: np.ndarray, response: np.ndarray, row: np.ndarray) -> None:
    """Write the sums over all taps, in their order."""
    row[:] = 0.0
    for tap in range(len(response)):
        weight = response[len(response) - 1 - tap]
        samples = phases[tap % len(phases), tap // len(phases) :]
        for k in range(len(row)):
            row[k] += samples[k] * weight


@cache
def _response(factor: int) -> np.ndarray:
    taps = CYCLES * factor + 1
    return signal.firwin(taps + 1 - taps % 2, PASS_BAND / factor, window=("kaiser", STOP_BAND))
