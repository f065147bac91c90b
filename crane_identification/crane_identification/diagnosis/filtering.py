"""The low-pass and decimation of the evidence, for the force and for every column alike.

A linear filter on both sides of (28) leaves Theta as it is. With a finite response only the rows
that are kept cost anything, which counts with hundreds of columns.
"""

from functools import cache

import numpy as np
from scipy import signal

from crane_identification.signals.decimate import PASS_BAND, decimation_rows

CYCLES = 12  # length of the response, in rows that are kept
STOP_BAND = 6.0  # shape of the Kaiser window: 60 dB


def thinned(values: np.ndarray, factor: int) -> np.ndarray:
    """Values (n, ...) at `decimation_rows`, filtered with zero phase; zero beyond the ends."""
    kept = decimation_rows(len(values), factor)
    if factor == 1:
        return values
    response = _response(factor)
    delay = len(response) // 2 + int(kept[0])
    before = -delay % factor
    flat = values.reshape(len(values), -1).T
    padded = np.concatenate([np.zeros((len(flat), before)), flat], axis=1)
    out = signal.upfirdn(response, padded, down=factor)
    first = (delay + before) // factor
    return out[:, first : first + len(kept)].T.reshape(len(kept), *values.shape[1:])


@cache
def _response(factor: int) -> np.ndarray:
    taps = CYCLES * factor + 1
    return signal.firwin(taps + 1 - taps % 2, PASS_BAND / factor, window=("kaiser", STOP_BAND))
