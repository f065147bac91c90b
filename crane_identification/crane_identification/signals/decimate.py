"""The same zero-phase low-pass and decimation for the force and for every regressor column.

A linear filter applied to both sides of (28) leaves Θ as it is and removes what lies above the
band in which the estimated motion can be trusted ("parallel filtering").
"""

from functools import cache

import numpy as np
from scipy import signal

from crane_model.errors import DataError, NoMotionError

CHEBYSHEV_ORDER = 8
RIPPLE_DB = 0.05  # dB
# Share of half the sampling rate after decimation; these three as MATLAB's decimate
PASS_BAND_SHARE = 0.8
FILTER_PADDING = 3 * CHEBYSHEV_ORDER
KEPT_SHARE = 0.2  # of the bandwidth of the motion
FILTER_MEMORY_ROWS = 64  # rows after which the filter has forgotten everything
UNFILTERED = np.ones(1)
"""Autocorrelation (lags,) of white noise that has passed no filter."""


def decimation_rows(samples: int, factor: int) -> np.ndarray:
    """Rows that are kept: every `factor`-th one, counted so that the last one is kept.

    As MATLAB's decimate, whose remainder is left out at the start.
    """
    kept = -(-samples // factor)
    return np.arange(samples - 1 - (kept - 1) * factor, samples, factor)


def decimate(values: np.ndarray, factor: int, periodic: bool = False) -> np.ndarray:
    """`values` (n, ...) filtered along the first axis, at `decimation_rows`.

    Chebyshev type I of order 8 with 0.05 dB ripple up to 0.8 of the new Nyquist frequency, run
    forwards and backwards; `periodic` continues one whole period of values over its ends.
    Factor 1 changes nothing. Raises `DataError` if there are too few samples.
    """
    n = len(values)
    if factor == 1:
        return values
    if n <= FILTER_PADDING:
        raise DataError(f"{n} samples cannot be filtered; at least {FILTER_PADDING + 1} are needed")
    sections = _low_pass(factor)
    rows = decimation_rows(n, factor)
    if not periodic:
        return signal.sosfiltfilt(sections, values, axis=0, padlen=FILTER_PADDING)[rows]
    around = np.concatenate([values, values, values])
    return signal.sosfiltfilt(sections, around, axis=0, padlen=FILTER_PADDING)[rows + n]


@cache
def filtered_noise(factor: int) -> np.ndarray:
    """Autocorrelation (lags,) that `decimate` gives to white noise."""
    if factor == 1:
        return UNFILTERED
    impulse = np.zeros(2 * FILTER_MEMORY_ROWS * factor)
    impulse[FILTER_MEMORY_ROWS * factor] = 1.0
    response = signal.sosfiltfilt(_low_pass(factor), impulse, padlen=0)
    covariance = signal.correlate(response, response)[len(response) - 1 :: factor][
        :FILTER_MEMORY_ROWS
    ]
    return covariance / covariance[0]


@cache
def _low_pass(factor: int) -> np.ndarray:
    return signal.cheby1(CHEBYSHEV_ORDER, RIPPLE_DB, PASS_BAND_SHARE / factor, output="sos")


def trusted_bandwidth(bandwidth: np.ndarray, known: np.ndarray) -> float:
    """Lowest bandwidth [Hz] of the joints that move at some time of `known` (n, j).

    That of a joint that stands still says nothing. `NoMotionError` if all of them do.
    """
    if not known.any():
        raise NoMotionError(
            "no joint moves fast enough to distinguish it from standstill; record a motion"
        )
    return float(bandwidth[known.any(axis=0)].min())


def decimation_factor(bandwidth: float, step: float) -> int:
    """Largest factor that keeps 0.2 of the `bandwidth` [Hz] of the motion (at least 1).

    There the estimated motion is the true one to 1e-4 (responses 1/(1 + 0.2⁶) and closer), so that
    even the short accelerations after a reversal are seen alike on both sides of (28).
    """
    return max(1, int(PASS_BAND_SHARE * 0.5 / step / (KEPT_SHARE * bandwidth) + 1e-9))
