"""Autocorrelation of a residual with gaps, by an autoregressive model (Burg 1967)."""

import numpy as np

HIGHEST_ORDER = 4
LARGEST_REFLECTION = 0.98  # keeps the memory of the model finite


def burg(residual: np.ndarray, used: np.ndarray, highest: int = HIGHEST_ORDER) -> np.ndarray:
    """Coefficients (order + 1,) of the AR polynomial 1 + a1 z⁻¹ + ..., order by Schwarz's criterion.

    `residual` (r, n) of r runs; only products of samples that are `used` (r, n), with everything
    between them, count. Stable by construction.
    """
    forward = backward = np.where(used, residual, 0.0)
    valid = used
    polynomial = best = np.ones(1)
    power = float((forward**2).sum() / max(used.sum(), 1))
    lowest = used.sum() * np.log(power) if power > 0 else -np.inf
    for order in range(1, highest + 1):
        valid = valid[:, 1:] & used[:, : used.shape[1] - order]
        ahead, behind = forward[:, 1:] * valid, backward[:, :-1] * valid
        energy = float((ahead**2 + behind**2).sum())
        if energy == 0.0:
            break
        limit = LARGEST_REFLECTION
        reflection = float(np.clip(-2 * (ahead * behind).sum() / energy, -limit, limit))
        forward, backward = ahead + reflection * behind, behind + reflection * ahead
        polynomial = np.append(polynomial, 0.0)
        polynomial = polynomial + reflection * polynomial[::-1]
        power *= 1 - reflection**2
        schwarz = used.sum() * np.log(power) + np.log(used.sum()) * order
        if schwarz < lowest:
            lowest, best = schwarz, polynomial
    return best


def autocorrelation(polynomial: np.ndarray, lags: int) -> np.ndarray:
    """Autocorrelation (lags,) of the process whitened by an AR polynomial; 1 at lag 0."""
    points = 8 * (lags + 64)
    spectrum = 1.0 / np.abs(np.fft.rfft(polynomial, points)) ** 2
    covariance = np.fft.irfft(spectrum, points)[:lags]
    return covariance / covariance[0]
