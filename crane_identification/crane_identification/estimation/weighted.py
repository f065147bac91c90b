"""Least squares weighted by the covariance of the noise between joints (generalized, Aitken)."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.linalg import solve_triangular

from crane_identification.estimation.covariance import Covariance
from crane_identification.estimation.estimate import Estimate, describe
from crane_identification.estimation.least_squares import check, fit
from crane_identification.estimation.rows import Rows
from crane_model.errors import DataError


def weighted(
    rows: Rows, noise: Sequence[np.ndarray], covariance: Covariance = Covariance.CORRELATED
) -> Estimate:
    """Θ that minimises Σ rᵀ C⁻¹ r over all instants, r = τ - ΦΘ of the joints used there.

    `noise`: C (j, j) of each run [products of N m or N], from the scatter between periods, so that
    no model has to be fitted first. `DataError` if one is not positive definite, and as
    `least_squares`.
    """
    check(rows)
    whitened = whiten(rows, noise)
    method = f"least squares weighted by the noise between joints, {covariance} residual"
    return describe(rows, fit(whitened, np.ones(len(rows.joints)), covariance), method)


def whiten(rows: Rows, noise: Sequence[np.ndarray]) -> Rows:
    """Rows whose noise has unit variance and is independent between joints.

    Those used at an instant are multiplied by L⁻¹, with L Lᵀ = C of these joints alone.
    """
    matrix, force = np.zeros_like(rows.matrix), np.zeros_like(rows.force)
    for run, covariance in enumerate(noise):
        for used in np.unique(rows.used[rows.run == run], axis=0):
            instants = np.flatnonzero((rows.run == run) & (rows.used == used).all(axis=1))
            joints = np.flatnonzero(used)
            if not joints.size:
                continue
            root = _root(covariance[np.ix_(joints, joints)], run)
            inverse = solve_triangular(root, np.eye(len(joints)), lower=True)
            cells = np.ix_(instants, joints)
            matrix[cells] = np.einsum("ij,njp->nip", inverse, rows.matrix[cells])
            force[cells] = rows.force[cells] @ inverse.T
    return replace(rows, matrix=matrix, force=force)


def _root(covariance: np.ndarray, run: int) -> np.ndarray:
    try:
        return np.linalg.cholesky(covariance)
    except np.linalg.LinAlgError:
        raise DataError(
            f"weights: the noise covariance of recording {run + 1} is not positive definite; it "
            f"takes at least two periods whose forces differ, or another estimator"
        ) from None
