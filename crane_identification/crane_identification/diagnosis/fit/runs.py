"""Gapless runs, and how their samples become rows: zones, low-pass and decimation.

A linear filter on both sides of (28) leaves Theta as it is. With a finite response only the rows
that are kept cost anything, which counts with hundreds of columns.
"""

from dataclasses import dataclass
from enum import Enum
from functools import cache, cached_property

import numpy as np
from numba import njit
from scipy import ndimage, signal

from crane_identification.estimation.regression import OPEN
from crane_identification.preparation.run import Preparation
from crane_identification.signals.decimate import PASS_BAND, decimation_rows
from crane_model.record import Record

OPEN_TURNING = 0.15
"""As `OPEN` close to reversals, which are shorter than what the filter sees."""
TOGETHER = 64  # samples that are looked through at once
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
        """(samples, j): where a channel of the joint sees it."""
        joints = self.record.position.shape[1]
        return np.asarray((self.gate.reshape(len(self.gate), -1, joints) > 0.0).any(axis=1))

    def reached(self, flags: np.ndarray) -> np.ndarray:
        """(n, ...): whether the filter of a row reaches a sample with a flag (samples, ...)."""
        size = 1 if self.factor == 1 else CYCLES * self.factor + 1
        return ndimage.maximum_filter1d(flags.astype(np.uint8), size, axis=0)[self.kept] > 0

    def filtered(self, columns: np.ndarray) -> np.ndarray:
        """(samples, j, k) to gated rows (n, channels, k); columns of zeros cost nothing."""
        zones = self.gate.shape[1] // columns.shape[1]
        out = np.zeros((len(self.kept), self.gate.shape[1], columns.shape[2]))
        there = acting(columns)
        for zone in range(zones):
            part = slice(zone * columns.shape[1], (zone + 1) * columns.shape[1])
            gate = self.gate[:, part][:, np.nonzero(there)[0]]
            out[:, part][:, there] = thinned(columns[:, there] * gate, self.factor)
        return out


def acting(columns: np.ndarray) -> np.ndarray:
    """(...): which columns of (samples, ...) are not all zero; many samples side by side, since of
    short rows numpy asks each by itself.
    """
    rows, width = len(columns) // TOGETHER, int(np.prod(columns.shape[1:]))
    flat = columns.reshape(len(columns), width)
    wide = flat[: rows * TOGETHER].reshape(rows, TOGETHER * width).any(axis=0)
    there = wide.reshape(TOGETHER, width).any(axis=0) | flat[rows * TOGETHER :].any(axis=0)
    return np.asarray(there.reshape(columns.shape[1:]))


def thinned(values: np.ndarray, factor: int) -> np.ndarray:
    """Values (n, ...) at `decimation_rows`, filtered with zero phase; zero beyond the ends."""
    kept = decimation_rows(len(values), factor)
    if factor == 1:
        return values
    flat = np.ascontiguousarray(values.reshape(len(values), -1).T)
    return _answers(flat, kept, _response(factor)).T.reshape(len(kept), *values.shape[1:])


@njit(cache=True)
def _answers(values: np.ndarray, kept: np.ndarray, response: np.ndarray) -> np.ndarray:
    """(m, rows) of a finite response (taps,) about the samples `kept` (rows,) of values (m, n).

    Four rows at once, each of which adds up its samples in order: one sum alone waits for itself.
    """
    half, last = len(response) // 2, values.shape[1] - 1
    out = np.zeros((len(values), len(kept)))
    for row in range(len(values)):
        x, k = values[row], 0
        while k < len(kept):
            begin = kept[k] - half
            if k + 4 <= len(kept) and begin >= 0 and kept[k + 3] + half <= last:
                second, third, fourth = kept[k + 1] - half, kept[k + 2] - half, kept[k + 3] - half
                a = b = c = d = 0.0
                for tap in range(len(response)):
                    weight = response[len(response) - 1 - tap]
                    a += x[begin + tap] * weight
                    b += x[second + tap] * weight
                    c += x[third + tap] * weight
                    d += x[fourth + tap] * weight
                out[row, k], out[row, k + 1], out[row, k + 2], out[row, k + 3] = a, b, c, d
                k += 4
            else:
                total = 0.0
                for i in range(max(begin, 0), min(kept[k] + half, last) + 1):
                    total += x[i] * response[kept[k] + half - i]
                out[row, k] = total
                k += 1
    return out


@cache
def _response(factor: int) -> np.ndarray:
    taps = CYCLES * factor + 1
    return signal.firwin(taps + 1 - taps % 2, PASS_BAND / factor, window=("kaiser", STOP_BAND))
