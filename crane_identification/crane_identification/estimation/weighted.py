"""Least squares weighted by the covariance of the noise between joints (generalized, Aitken)."""

from dataclasses import replace

import numpy as np
from scipy.linalg import solve_triangular

from crane_identification.estimation.estimate import Estimate, describe
from crane_identification.estimation.least_squares import fit
from crane_identification.estimation.rows import Rows, check
from crane_identification.options import Covariance
from crane_model.errors import DataError


def weighted(rows: Rows, covariance: Covariance = Covariance.CORRELATED) -> Estimate:
    """Θ that minimises Σ rᵀ C⁻¹ r over all instants, r = τ - ΦΘ of the joints used there.

    C (j, j) of each recording comes from the scatter of its periods, so that no model has to be
    fitted first. `DataError` where no period was repeated, and as `least_squares`.
    """
    check(rows)
    if not rows.repeated:
        raise DataError(
            "weights: the noise between joints is the scatter between periods, and a recording has "
            "one period only; record at least two, average, or choose another estimator"
        )
    method = f"least squares weighted by the noise between joints, {covariance} residual"
    return describe(rows, fit(whiten(rows), np.ones(len(rows.joints)), covariance), method)


def noise_between_joints(rows: Rows, run: int) -> np.ndarray:
    """Covariance (j, j) of the noise of the mean force of a recording, over its used rows."""
    used, deviation = rows.used[rows.run == run], rows.scatter[run]
    count = len(deviation)
    masked = np.where(used, deviation, 0.0)
    power = np.einsum("mnj,mnk->jk", masked, masked) / (count - 1) / count
    both = used.T.astype(float) @ used
    return np.where(both > 0, power / np.maximum(both, 1), 0.0)


def whiten(rows: Rows) -> Rows:
    """Rows whose noise has unit variance and is independent between joints.

    Those used at an instant are multiplied by L⁻¹, with L Lᵀ = C of these joints alone.
    """
    matrix, force = np.zeros_like(rows.matrix), np.zeros_like(rows.force)
    scatter = []
    for run, deviation in enumerate(rows.scatter):
        covariance, own = noise_between_joints(rows, run), np.flatnonzero(rows.run == run)
        whitened = np.zeros_like(deviation)
        for pattern in np.unique(rows.used[own], axis=0):
            joints = np.flatnonzero(pattern)
            within = np.flatnonzero((rows.used[own] == pattern).all(axis=1))
            root = _root(covariance[np.ix_(joints, joints)], run)
            inverse = solve_triangular(root, np.eye(len(joints)), lower=True)
            cells = np.ix_(own[within], joints)
            matrix[cells] = np.einsum("ij,njp->nip", inverse, rows.matrix[cells])
            force[cells] = rows.force[cells] @ inverse.T
            every = np.arange(len(deviation))
            whitened[np.ix_(every, within, joints)] = (
                deviation[np.ix_(every, within, joints)] @ inverse.T
            )
        scatter.append(whitened)
    return replace(rows, matrix=matrix, force=force, scatter=tuple(scatter))


def _root(covariance: np.ndarray, run: int) -> np.ndarray:
    try:
        return np.linalg.cholesky(covariance)
    except np.linalg.LinAlgError:
        raise DataError(
            f"weights: the noise covariance of recording {run + 1} is not positive definite; the "
            f"forces of its periods must differ; or choose another estimator"
        ) from None
