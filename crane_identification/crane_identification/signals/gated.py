"""Zero-phase low-pass and decimation with a finite response, of samples that gates let through.

A linear filter on both sides of (28) leaves Theta as it is. With a finite response only the rows
that are kept cost anything, which counts with hundreds of columns.
"""

from functools import cache
from typing import NamedTuple

import numpy as np
from numba import njit
from scipy import ndimage, signal

from crane_identification.signals.decimate import PASS_BAND_SHARE, decimation_rows

CYCLES = 12  # length of the response, in rows that are kept
STOP_BAND = 6.0  # shape of the Kaiser window: 60 dB


def thinned(values: np.ndarray, factor: int) -> np.ndarray:
    """Values (n, ...) at `decimation_rows`, filtered with zero phase; zero beyond the ends."""
    if factor == 1:
        return values
    flat = values.reshape(len(values), 1, -1)
    out = GatedFilter(np.ones((len(values), 1)), factor).rows(flat)
    return out.reshape(len(out), *values.shape[1:])


def row_noise(factor: int) -> float:
    """Standard deviation of a row over that of samples whose noise is white."""
    return 1.0 if factor == 1 else float(np.linalg.norm(_response(factor)))


def reached(flags: np.ndarray, factor: int) -> np.ndarray:
    """Return whether the filter of a row (n, ...) reaches a flag (samples, ...)."""
    size = 1 if factor == 1 else CYCLES * factor + 1
    flagged = ndimage.maximum_filter1d(flags.astype(np.uint8), size, axis=0)
    return flagged[decimation_rows(len(flags), factor)] > 0


class _Open(NamedTuple):
    """Samples at which the gates of channels are open, and by how much. Sample `factor` m + p of
    the window of a row lies at (p, m) of `phases`; those of a channel end at `ends` (channels,).
    """

    sample: np.ndarray
    gate: np.ndarray
    place: np.ndarray
    ends: np.ndarray
    phases: tuple[int, int]
    rows: int


class GatedFilter:
    """The filter of samples that gates (samples, channels) let through."""

    def __init__(self, gate: np.ndarray, factor: int) -> None:
        self._gate, self._factor = gate, factor
        if factor == 1:
            return
        taps, kept = len(_response(factor)), decimation_rows(len(gate), factor)
        phases = factor, len(kept) + taps // factor + 1
        first = int(kept[0]) - taps // 2 if len(kept) else 0  # before the first sample: zeros
        channel, sample = np.nonzero(gate.T)
        later, phase = np.divmod(sample - first, factor)
        ends = np.searchsorted(channel, np.arange(gate.shape[1]), side="right")
        place = phase * phases[1] + later
        self._open = _Open(sample, gate[sample, channel], place, ends, phases, len(kept))

    def rows(self, columns: np.ndarray) -> np.ndarray:
        """Columns (samples, j, k) as gated rows (n, channels, k), j channels in turn; columns of
        zeros cost next to nothing.
        """
        if self._factor == 1:
            zones = self._gate.shape[1] // columns.shape[1]
            return np.tile(columns, (1, zones, 1)) * self._gate[..., np.newaxis]
        return _gated(columns, self._open, _response(self._factor))


@njit(cache=True)
def _gated(columns: np.ndarray, open_: _Open, response: np.ndarray) -> np.ndarray:
    """Columns (n, j, k), gated and filtered by a response (taps,): (rows, channels, k)."""
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
    row[:] = 0.0
    for tap in range(len(response)):
        weight = response[len(response) - 1 - tap]
        samples = phases[tap % len(phases), tap // len(phases) :]
        for k in range(len(row)):
            row[k] += samples[k] * weight


@cache
def _response(factor: int) -> np.ndarray:
    taps = CYCLES * factor + 1
    return signal.firwin(
        taps + 1 - taps % 2, PASS_BAND_SHARE / factor, window=("kaiser", STOP_BAND)
    )
