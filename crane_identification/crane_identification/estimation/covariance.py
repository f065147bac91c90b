"""How uncertain least-squares estimates are, under three assumptions about the residual."""

from enum import StrEnum

import numpy as np
from scipy.linalg import matmul_toeplitz

from crane_identification.estimation.autoregression import autocorrelation, burg
from crane_identification.estimation.rows import Rows


class Covariance(StrEnum):
    """What is assumed of the residual.

    CLASSICAL: white; its variance is its sum of squares over (rows - parameters).
    SAMPLE: white; its variance is the sample variance about its mean, as usual in robotics (EMPS).
    CORRELATED: an autoregressive process of its own in each joint, fitted to the residual.
    """

    CLASSICAL = "classical"
    SAMPLE = "sample"
    CORRELATED = "correlated"


def white(residual: np.ndarray, bread: np.ndarray, assumption: Covariance) -> np.ndarray:
    """Covariance (p, p) of the estimate for a white weighted residual (N,).

    `bread` is (ΦᵀW²Φ)⁻¹.
    """
    if assumption is Covariance.SAMPLE:
        return bread * np.var(residual, ddof=1)
    return bread * (residual @ residual) / (len(residual) - len(bread))


def correlated(
    rows: Rows, weights: np.ndarray, residual: np.ndarray, bread: np.ndarray
) -> np.ndarray:
    """Covariance B (Σ ΦᵀW Γ WΦ) B (p, p), Γ the autocovariance of the weighted residual (n, j).

    Γ comes from an AR model of each joint. On records of a few hundred rows its intervals cover
    what they claim where those of a kernel estimate (Newey and West) are up to twice too narrow.
    The residual is smaller than the noise because p parameters were fitted to it; the factor that
    makes its expected sum of squares come out right corrects for that.
    """
    runs = [np.flatnonzero(rows.run == run) for run in np.unique(rows.run)]
    meat = np.zeros_like(bread)
    power: float = 0.0
    for j in range(len(rows.joints)):
        used = rows.used[:, j]
        if not used.any():
            continue
        polynomial = burg(_by_run(residual[:, j], runs), _by_run(used, runs))
        variance = float((residual[used, j] ** 2).mean())
        columns = rows.matrix[:, j] * np.where(used, weights[:, j], 0.0)[:, None]
        shape = variance * autocorrelation(polynomial, max(len(run) for run in runs))
        for run in runs:
            meat += columns[run].T @ matmul_toeplitz(shape[: len(run)], columns[run])
        power += variance * int(used.sum())
    explained = float(np.trace(bread @ meat))
    parameters = int(np.count_nonzero(np.diag(bread)))
    most: float = 1.0 - 1.0 / max(rows.samples - parameters, 2)
    left = 1.0 - min(explained / power, most) if power > 0.0 else 1.0
    return bread @ meat @ bread / left


def _by_run(values: np.ndarray, runs: list[np.ndarray]) -> np.ndarray:
    """(n,) to (runs, longest run), padded with zeros."""
    out = np.zeros((len(runs), max(len(run) for run in runs)), dtype=values.dtype)
    for i, run in enumerate(runs):
        out[i, : len(run)] = values[run]
    return out
