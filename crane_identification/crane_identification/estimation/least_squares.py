"""Least squares (30)-(31) by orthogonal decomposition, with weights, rank check and uncertainty."""

import numpy as np

from crane_identification.estimation.covariance import Covariance, correlated, white
from crane_identification.estimation.estimate import Estimate
from crane_identification.estimation.rows import Rows
from crane_model.base_parameters import reveal_rank
from crane_model.errors import DataError

RANK_TOLERANCE = 1e-9
CONTAINED = 1e-6  # share of a dependent column's norm above which another is part of it
PASSES = 50
SAME_WEIGHTS = 1e-3  # relative change
ROUNDING = 1e-12  # share of the forces below which a residual is rounding, not noise


def least_squares(
    rows: Rows, covariance: Covariance = Covariance.CORRELATED, weights: np.ndarray | None = None
) -> Estimate:
    """Θ that minimises the weighted norm of τ - ΦΘ (30).

    `weights` multiply the rows: (j,) or (n, j), in 1/N m and 1/N. Without them, one joint is
    fitted as (31) stands; with several, that is the first pass, and further ones weight each joint
    by the inverse of its root mean square residual until the weights stay the same.

    Raises `DataError` if there are fewer rows than parameters or a row is not finite.
    """
    _check(rows)
    if weights is None:
        weights = np.ones(len(rows.joints)) if len(rows.joints) == 1 else balancing(rows)
    weights = np.broadcast_to(weights, rows.force.shape)
    values, determined, bread = _solve(rows, weights)
    residual = rows.residual(values)
    weighted = weights * residual
    if covariance is Covariance.CORRELATED:
        spread = correlated(rows, weights, weighted, bread)
    else:
        spread = white(weighted[rows.used], bread, covariance)
    values = np.where(determined, values, np.nan)
    spread = np.where(determined[:, None] & determined, spread, np.nan)
    counts = np.maximum(rows.used.sum(axis=0), 1)
    raw, normalized = condition_numbers(rows.stacked)
    return Estimate(
        names=rows.names,
        units=rows.units,
        joints=rows.joints,
        values=values,
        std_devs=np.sqrt(np.diag(spread)),
        covariance=spread,
        undetermined=tuple(np.array(rows.names)[~determined].tolist()),
        condition_number=raw,
        condition_number_normalized=normalized,
        residual_rms=rows.norms(residual) / np.sqrt(counts),
        relative_error=relative(rows.norms(residual), rows.norms(rows.force)),
        samples=rows.samples,
        method=f"least squares (31), {covariance} residual",
    )


def condition_numbers(stacked: np.ndarray) -> tuple[float, float]:
    """Condition number of columns (N, p) as they are, and with each scaled to norm 1."""
    norms = np.linalg.norm(stacked, axis=0)
    if not norms.all():
        return np.inf, np.inf
    return float(np.linalg.cond(stacked)), float(np.linalg.cond(stacked / norms))


def balancing(rows: Rows) -> np.ndarray:
    """Weights (j,) with which the weighted residual of each joint has root mean square 1."""
    weights = np.ones(len(rows.joints))
    for _ in range(PASSES):
        before, weights = weights, _inverse_residuals(rows, _solve(rows, weights)[0])
        if (np.abs(np.log(weights / before)) < SAME_WEIGHTS).all():
            break
    return weights


def _inverse_residuals(rows: Rows, values: np.ndarray) -> np.ndarray:
    counts = np.maximum(rows.used.sum(axis=0), 1)
    residual = rows.norms(rows.residual(values)) / np.sqrt(counts)
    force = rows.norms(rows.force) / np.sqrt(counts)
    floor = np.where(force > 0.0, ROUNDING * force, 1.0)
    return 1.0 / np.maximum(residual, floor)


def relative(part: np.ndarray, whole: np.ndarray) -> np.ndarray:
    """part / whole, NaN where there is nothing to compare with."""
    return np.divide(part, whole, out=np.full_like(whole, np.nan), where=whole > 0)


def _solve(rows: Rows, weights: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Basic solution (p,), which of it is determined (p,), and (ΦᵀW²Φ)⁻¹ (p, p).

    Columns are scaled to norm 1 inside, so that the units of the parameters do not matter.
    """
    scaling = np.broadcast_to(weights, rows.force.shape)[rows.used]
    matrix = rows.stacked * scaling[:, None]
    force = rows.force[rows.used] * scaling
    basis = reveal_rank(matrix, RANK_TOLERANCE)
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
    return values, determined, bread


def _check(rows: Rows) -> None:
    parameters = len(rows.names)
    if rows.samples <= parameters:
        raise DataError(
            f"least squares: {rows.samples} rows for {parameters} parameters; record longer, "
            f"decimate less or mask less around reversals"
        )
    bad = rows.used & ~(np.isfinite(rows.force) & np.isfinite(rows.matrix).all(axis=2))
    if bad.any():
        instant, joint = np.argwhere(bad)[0]
        raise DataError(
            f"least squares: joint {rows.joints[joint]} at {rows.time[instant]:.4g} s: force or "
            f"regressor is not finite; cut the recording to where every sensor was logged"
        )
