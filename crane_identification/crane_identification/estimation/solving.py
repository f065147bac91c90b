"""What every estimator shares: a rank-revealing solution, and weights that balance the joints."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from crane_model.base_parameters import reveal_rank

RANK_TOLERANCE = 1e-9
CONTAINED = 1e-6  # share of a dependent column's norm above which another is part of it
PASSES = 50
SAME_WEIGHTS = 1e-3  # relative change
ROUNDING = 1e-12  # share of the forces below which a residual is rounding, not noise


class BasicSolution(NamedTuple):
    """Least squares on the independent columns; the others have the value 0.

    `values` (p,), which of them is `determined` (p,), `bread` (AᵀA)⁻¹ (p, p), zero where dependent,
    and the `condition` number of the columns scaled to norm 1 (inf if rank deficient).
    """

    values: np.ndarray
    determined: np.ndarray
    bread: np.ndarray
    condition: float


def solve(
    matrix: np.ndarray, force: np.ndarray, tolerance: float = RANK_TOLERANCE
) -> BasicSolution:
    """Least squares of weighted rows `matrix` (N, p), `force` (N,) by orthogonal decomposition.

    Columns are scaled to norm 1 inside, so that the units of the parameters do not matter; what is
    within `tolerance` of the others counts as dependent on them.
    """
    basis = reveal_rank(matrix, tolerance)
    kept, dropped = list(basis.independent), list(basis.dependent)
    norms = np.linalg.norm(matrix, axis=0)
    q, r = np.linalg.qr(matrix[:, kept] / norms[kept])
    inverse = np.linalg.solve(r, np.eye(len(kept))) / norms[kept][:, None]
    parameters = matrix.shape[1]
    values, bread = np.zeros(parameters), np.zeros((parameters, parameters))
    values[kept] = inverse @ (q.T @ force)
    bread[np.ix_(kept, kept)] = inverse @ inverse.T
    # A parameter is determined if no dropped column contains its column.
    contained = np.abs(basis.combination) * norms[kept][:, None]
    determined = np.zeros(parameters, dtype=bool)
    determined[kept] = (contained <= CONTAINED * norms[dropped]).all(axis=1)
    return BasicSolution(values, determined, bread, np.inf if dropped else float(np.linalg.cond(r)))


def balance(
    joints: int, residuals: Callable[[np.ndarray], np.ndarray], force: np.ndarray
) -> np.ndarray:
    """Weights (j,) with which the weighted residual of each joint has root mean square 1.

    `residuals` gives the root mean square residual (j,) of the solution with given weights; a
    single joint needs no weight. Of residuals that are rounding beside the `force` (j,), root mean
    square, none counts more than another.
    """
    weights = np.ones(joints)
    floor = np.where(force > 0.0, ROUNDING * force, 1.0)
    for _ in range(PASSES if joints > 1 else 0):
        before, weights = weights, 1.0 / np.maximum(residuals(weights), floor)
        if (np.abs(np.log(weights / before)) < SAME_WEIGHTS).all():
            break
    return weights
