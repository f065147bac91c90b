"""Least squares (30)-(31) by orthogonal decomposition, with weights, rank check and uncertainty."""

from typing import NamedTuple

import numpy as np

from crane_identification.estimation.covariance import correlated, noise_of_joints, white
from crane_identification.estimation.estimate import Estimate, Fit, describe
from crane_identification.estimation.lack_of_fit import lack_of_fit
from crane_identification.estimation.prior import Prior
from crane_identification.estimation.rows import Rows, balancing, check, solve, solve_weighted
from crane_identification.options import Covariance

UNSEEN = 1.0
"""A parameter is not determined if one standard deviation of it changes the force, on some joint,
by as much as the whole measured force."""


def least_squares(
    rows: Rows,
    covariance: Covariance = Covariance.CORRELATED,
    weights: np.ndarray | None = None,
    prior: Prior | None = None,
) -> Estimate:
    """Θ that minimises the weighted norm of τ - ΦΘ (30).

    `weights` multiply the rows: (j,) or (n, j), in 1/N m and 1/N. Without them, one joint is
    fitted as (31) stands; with several, each is weighted by the inverse of its root mean square
    residual, in passes from equal weights until they stay the same. A `prior` counts beside them.

    Raises `DataError` if there are fewer rows than parameters or a row is not finite.
    """
    check(rows)
    weights = balancing(rows) if weights is None else weights
    found = fit(rows, weights, covariance, prior)
    method = f"least squares (31){' with a prior' if prior else ''}, {covariance} residual"
    return describe(rows, found, method)


class Spread(NamedTuple):
    """`covariance` (p, p) of an estimate, and that by the most `likely` noise, taken for certain.

    The likely one weighs a prior and tells what is seen at all; the other is reported.
    """

    covariance: np.ndarray
    likely: np.ndarray


def fit(rows: Rows, weights: np.ndarray, covariance: Covariance, prior: Prior | None = None) -> Fit:
    """Θ and its covariance for given weights, (j,) or (n, j), and a prior."""
    weights = np.broadcast_to(weights, rows.force.shape)
    values, determined, bread, _ = solve_weighted(rows, weights)
    spread = spread_of(rows, weights, values, bread, covariance)
    if prior is None:
        return Fit(values, spread.covariance, determined & _seen(rows, spread.likely))
    scaling = weights[rows.used]
    matrix, force = rows.stacked * scaling[:, None], rows.force[rows.used] * scaling
    # Noise that is correlated from row to row makes rows count for fewer than they are.
    rank = np.count_nonzero(np.diag(bread))
    excess = float(np.trace(spread.likely @ (matrix.T @ matrix))) / rank
    beforehand = prior.matrix * np.sqrt(excess), prior.values * np.sqrt(excess)
    values, determined, bread, _ = solve(
        np.vstack([matrix, beforehand[0]]), np.concatenate([force, beforehand[1]])
    )
    carried = bread @ beforehand[0].T
    of_prior = excess * carried @ carried.T
    spread = spread_of(rows, weights, values, bread, covariance)
    seen = determined & _seen(rows, spread.likely + of_prior)
    return Fit(values, spread.covariance + of_prior, seen, beforehand)


def spread_of(
    rows: Rows, weights: np.ndarray, values: np.ndarray, bread: np.ndarray, covariance: Covariance
) -> Spread:
    """What the noise of the rows gives to the solution with this `bread`."""
    residual = weights * rows.residual(values)
    if covariance is Covariance.CORRELATED:
        joints = noise_of_joints(rows, weights, residual, lack_of_fit(rows, values))
        likely = bread @ np.sum([one.likely for one in joints], axis=0) @ bread
        return Spread(correlated(joints, bread), likely)
    found = white(residual[rows.used], bread, covariance)
    return Spread(found, found)


def _seen(rows: Rows, covariance: np.ndarray) -> np.ndarray:
    """(p,): whether the force says more about a parameter than that it is there."""
    std_devs = np.sqrt(np.diag(covariance))
    columns = np.stack([rows.rms(rows.matrix[:, :, k]) for k in range(len(rows.names))])
    force = rows.rms(rows.force)
    hidden = (columns * std_devs[:, None] > UNSEEN * force) & (columns > 0.0)
    return np.asarray(~hidden.any(axis=1))
