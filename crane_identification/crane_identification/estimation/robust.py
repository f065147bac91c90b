"""Robust regression: iteratively reweighted least squares that outliers cannot steer.

Tukey's bisquare (Beaton and Tukey 1974) from a start by Huber's loss, which has one minimum only;
both with the usual constants, 95 % efficient on normal noise.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from crane_identification.estimation.estimate import Estimate, describe
from crane_identification.estimation.least_squares import fit
from crane_identification.estimation.rows import Rows, balancing, check, solve_weighted
from crane_identification.options import Covariance

HUBER, BISQUARE = 1.345, 4.685  # standard deviations
NORMAL = 1.4826  # standard deviation over median absolute deviation of normal noise
PASSES = 100
SAME = 1e-6  # change of the residuals, in scales

Loss = Callable[[np.ndarray], np.ndarray]
"""Weight ψ(u)/u of residuals u, counted in scales."""


def huber(u: np.ndarray) -> np.ndarray:
    """min(1, k/|u|): large residuals pull with constant force."""
    return HUBER / np.maximum(np.abs(u), HUBER)


def bisquare(u: np.ndarray) -> np.ndarray:
    """(1 - (u/k)²)², 0 beyond k: gross errors do not pull at all."""
    return np.clip(1.0 - (u / BISQUARE) ** 2, 0.0, None) ** 2


def robust(rows: Rows, covariance: Covariance = Covariance.CORRELATED) -> Estimate:
    """Θ that minimises the bisquare loss of the residuals, each joint counted in its own scale.

    With Huber's pseudo-values, ΦΘ + s ψ(r/s)/m where m is the mean of ψ', least squares gives the
    same Θ and its asymptotic covariance, correlated or not. `DataError` as `least_squares`.
    """
    check(rows)
    values = solve_weighted(rows, balancing(rows)).values
    scale = _scale(rows, values)
    for loss in (huber, bisquare):
        values, scale = _reweighted(rows, loss, scale)
    u = rows.residual(values) / scale
    slope = np.where(rows.used, _slope(u), 0.0).sum(axis=0) / np.maximum(rows.used.sum(axis=0), 1)
    pseudo = rows.matrix @ values + scale * bisquare(u) * u / slope
    found = fit(replace(rows, force=pseudo, scatter=()), np.sqrt(slope) / scale, covariance)
    rejected = int((rows.used & (np.abs(u) > BISQUARE)).sum())
    method = f"robust regression (bisquare), {rejected} rows rejected, {covariance} residual"
    return describe(rows, found, method)


def _reweighted(rows: Rows, loss: Loss, scale: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Θ and the scale (j,) of the residuals, repeated until neither moves."""
    u = np.zeros_like(rows.force)
    for _ in range(PASSES):
        before = u
        values = solve_weighted(rows, np.sqrt(loss(u)) / scale).values
        u = rows.residual(values) / scale
        if np.abs(u - before).max() < SAME:
            break
        scale = _scale(rows, values)
    return values, scale


def _scale(rows: Rows, values: np.ndarray) -> np.ndarray:
    """Standard deviation (j,) of the residuals that normal noise of their median size has."""
    residual = np.where(rows.used, np.abs(rows.residual(values)), np.nan)
    size = NORMAL * np.nanmedian(residual, axis=0)
    return np.maximum(np.nan_to_num(size, nan=1.0), np.finfo(float).tiny ** 0.25)


def _slope(u: np.ndarray) -> np.ndarray:
    """ψ' of the bisquare."""
    inside = 1.0 - (u / BISQUARE) ** 2
    return np.where(inside > 0.0, inside * (1.0 - 5.0 * (u / BISQUARE) ** 2), 0.0)
