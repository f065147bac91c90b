"""How many correlated residuals are worth one independent one, followed as they come."""

import numpy as np
from numba import njit

from crane_identification.estimation.autoregression import HIGHEST_ORDER, LARGEST_REFLECTION

MEMORY = 2000
"""Rows over which the autocovariance is averaged, so that the residuals of the first, poor
estimates are forgotten."""


class ResidualCorrelation:
    """An autoregression of order 4 of the residual of each joint, from running autocovariances.

    The factor is the residual's spectral density at frequency 0 over that of white noise of the
    same variance: the mean of slowly varying correlated residuals has that many times the variance.
    It holds where the regressor varies slowly compared with the memory of the residual, as it does
    for sensor noise behind the smoother; it does not cover model errors that last as long as the
    motion itself (a missing effect looks like a bias, not like noise).
    """

    def __init__(self, joints: int):
        self._products = np.zeros((joints, HIGHEST_ORDER + 1))
        self._counts = np.zeros((joints, HIGHEST_ORDER + 1))
        self._past = np.full((joints, HIGHEST_ORDER), np.nan)

    def add(self, residual: np.ndarray, used: np.ndarray) -> None:
        """The residuals (j,) of the next row of the grid; those not `used` (j,) are gaps."""
        values = np.where(used, residual, np.nan)
        _accumulate(values, self._past, self._products, self._counts, 1.0 - 1.0 / MEMORY)

    def interrupt(self) -> None:
        """The next row does not follow the last one."""
        self._past[:] = np.nan

    def factors(self) -> np.ndarray:
        """(j,) rows that are worth one independent row, at least 1; 1 where nothing is known."""
        known = (self._counts > 0.0).sum(axis=1)
        means = self._products / np.maximum(self._counts, 1.0)
        return np.array([_long_run(c[:n]) for c, n in zip(means, known, strict=True)])


def _long_run(autocovariance: np.ndarray) -> float:
    """Density at frequency 0 over variance of the autoregression (Levinson), at least 1."""
    if not autocovariance.any():
        return 1.0
    power = autocovariance[0]
    polynomial, variance = np.ones(1), power
    for order in range(1, len(autocovariance)):
        ahead = polynomial @ autocovariance[order:0:-1]
        reflection = np.clip(-ahead / variance, -LARGEST_REFLECTION, LARGEST_REFLECTION)
        polynomial = np.append(polynomial, 0.0)
        polynomial = polynomial + reflection * polynomial[::-1]
        variance *= 1.0 - reflection**2
    return float(max(variance / polynomial.sum() ** 2 / power, 1.0))


@njit(cache=True)
def _accumulate(
    values: np.ndarray, past: np.ndarray, products: np.ndarray, counts: np.ndarray, keep: float
) -> None:
    joints, lags = past.shape
    for j in range(joints):
        if not np.isnan(values[j]):
            for lag in range(lags + 1):
                before = values[j] if lag == 0 else past[j, lag - 1]
                if np.isnan(before):
                    break  # only with everything between them
                products[j, lag] = keep * products[j, lag] + values[j] * before
                counts[j, lag] = keep * counts[j, lag] + 1.0
        for lag in range(lags - 1, 0, -1):
            past[j, lag] = past[j, lag - 1]
        past[j, 0] = values[j]
