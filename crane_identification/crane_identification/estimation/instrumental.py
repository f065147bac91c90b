"""Instrumental variables: consistent where feedback lets the noise into the regressor.

A force that the model does not know moves the joint; the controller (36) answers, and so the
measured motion, Φ, is correlated with the noise of (28): least squares is biased, however long the
recording. The motion that was asked for is not: Z is the regressor along the reference.
"""

from dataclasses import replace

import numpy as np

from crane_identification.estimation.estimate import Estimate, describe
from crane_identification.estimation.least_squares import fit
from crane_identification.estimation.rows import Rows, balance, check, solve_weighted
from crane_identification.options import Covariance


def instrumental(
    rows: Rows, instruments: np.ndarray, covariance: Covariance = Covariance.CORRELATED
) -> Estimate:
    """Θ for which the residual is orthogonal to the instruments: Zᵀ W² (τ - ΦΘ) = 0.

    `instruments` (n, j, p): Φ along a motion free of noise. The joints are balanced as in
    `least_squares`. With Φ̂ the projection of Φ on Z, least squares of Φ̂Θ + (τ - ΦΘ) on Φ̂ has the
    same solution and its covariance. `DataError` as `least_squares`.
    """
    check(rows)
    joints = len(rows.joints)

    def projected(weights: np.ndarray) -> Rows:
        scaling = np.broadcast_to(weights, rows.force.shape)[rows.used][:, None]
        basis = np.linalg.qr(instruments[rows.used] * scaling)[0]
        matrix = np.zeros_like(rows.matrix)
        matrix[rows.used] = basis @ (basis.T @ (rows.stacked * scaling)) / scaling
        return replace(rows, matrix=matrix)

    def values(weights: np.ndarray) -> np.ndarray:
        return solve_weighted(projected(weights), weights).values

    weights = balance(joints, lambda w: rows.rms(rows.residual(values(w))), rows.rms(rows.force))
    seen = projected(weights)
    theta = values(weights)
    pseudo = replace(seen, force=seen.matrix @ theta + rows.residual(theta))
    method = f"instrumental variables (reference), {covariance} residual"
    return describe(rows, fit(pseudo, weights, covariance), method)
