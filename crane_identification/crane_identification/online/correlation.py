"""How many correlated residuals are worth one independent one, followed as they come."""

import numpy as np
from numba import njit

FADING = 3
"""A residual weighs as this power of its number, so that those of the first, poor estimates are
forgotten, and an estimate from n rows rests on some n/2 residuals."""


class ResidualCorrelation:
    """The autocovariances of the residual of each joint up to `lags` rows, and what they add up to.

    The factor is the residual's spectral density at frequency 0 over that of white noise of the
    same variance: the mean of slowly varying correlated residuals has that many times the variance.
    It is the sum of autocorrelations, those beyond half the lags fading out (the flat-top window of
    Politis and Romano 1995), and never below `least`, what the overlap of rows makes of white
    noise. No autoregression: rows that are averages have next to nothing at their highest
    frequencies, and there a fitted polynomial is nearly singular.

    It holds where the regressor varies slowly compared with the memory of the residual, as it does
    for sensor noise; it does not cover model errors that last as long as the motion itself (a
    missing effect looks like a bias, not like noise).
    """

    def __init__(self, joints: int, lags: int, least: float = 1.0):
        self._least = least
        self._weights = np.clip(2.0 - 2.0 * np.arange(lags + 1) / (lags + 1), 0.0, 1.0)
        self._products = np.zeros((joints, lags + 1))
        self._counts = np.zeros((joints, lags + 1))
        self._past = np.full((joints, lags), np.nan)

    def add(self, residual: np.ndarray, used: np.ndarray) -> None:
        """The residuals (j,) of the next row of the grid; those not `used` (j,) are gaps."""
        values = np.where(used, residual, np.nan)
        _accumulate(values, self._past, self._products, self._counts)

    def interrupt(self) -> None:
        """The next row does not follow the last one."""
        self._past[:] = np.nan

    def factors(self) -> np.ndarray:
        """(j,) rows that are worth one independent row, at least `least`."""
        means = self._products / np.maximum(self._counts, 1.0)
        power = np.where(means[:, 0] > 0.0, means[:, 0], 1.0)
        return np.maximum(2.0 * means @ self._weights / power - 1.0, self._least)


@njit(cache=True)
def _accumulate(
    values: np.ndarray, past: np.ndarray, products: np.ndarray, counts: np.ndarray
) -> None:
    joints, lags = past.shape
    for j in range(joints):
        if not np.isnan(values[j]):
            for lag in range(lags + 1):
                before = values[j] if lag == 0 else past[j, lag - 1]
                if np.isnan(before):
                    break  # only with everything between them
                # the weights 1, ..., n to the power FADING, but for a common factor
                count = max(counts[j, lag], FADING / (FADING + 1.0))
                keep = 1.0 - FADING / ((FADING + 1.0) * count)
                products[j, lag] = keep * products[j, lag] + values[j] * before
                counts[j, lag] = keep * counts[j, lag] + 1.0
        for lag in range(lags - 1, 0, -1):
            past[j, lag] = past[j, lag - 1]
        past[j, 0] = values[j]
