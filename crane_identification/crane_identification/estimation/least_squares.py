"""Least squares (30)-(31) by orthogonal decomposition, with weights, rank check and uncertainty."""

import numpy as np

from crane_identification.estimation.covariance import correlated, white
from crane_identification.estimation.estimate import Estimate, Fit, describe
from crane_identification.estimation.lack_of_fit import lack_of_fit
from crane_identification.estimation.rows import Rows, balancing, check, solve_weighted
from crane_identification.options import Covariance

UNSEEN = 1.0
"""A parameter is not determined if one standard deviation of it changes the force, on some joint,
by as much as the whole measured force."""


def least_squares(
    rows: Rows, covariance: Covariance = Covariance.CORRELATED, weights: np.ndarray | None = None
) -> Estimate:
    """Θ that minimises the weighted norm of τ - ΦΘ (30).

    `weights` multiply the rows: (j,) or (n, j), in 1/N m and 1/N. Without them, one joint is
    fitted as (31) stands; with several, each is weighted by the inverse of its root mean square
    residual, in passes from equal weights until they stay the same.

    Raises `DataError` if there are fewer rows than parameters or a row is not finite.
    """
    check(rows)
    weights = balancing(rows) if weights is None else weights
    return describe(
        rows, fit(rows, weights, covariance), f"least squares (31), {covariance} residual"
    )


def fit(rows: Rows, weights: np.ndarray, covariance: Covariance) -> Fit:
    """Θ and its covariance for given weights, (j,) or (n, j)."""
    weights = np.broadcast_to(weights, rows.force.shape)
    values, determined, bread, _ = solve_weighted(rows, weights)
    residual = weights * rows.residual(values)
    if covariance is Covariance.CORRELATED:
        spread = correlated(rows, weights, residual, bread, lack_of_fit(rows, values))
    else:
        spread = white(residual[rows.used], bread, covariance)
    return Fit(values, spread, determined & _seen(rows, np.sqrt(np.diag(spread))))


def _seen(rows: Rows, std_devs: np.ndarray) -> np.ndarray:
    """(p,): whether the force says more about a parameter than that it is there."""
    columns = np.stack([rows.rms(rows.matrix[:, :, k]) for k in range(len(rows.names))])
    force = rows.rms(rows.force)
    return ~((columns * std_devs[:, None] > UNSEEN * force) & (columns > 0.0)).any(axis=1)
