"""How uncertain least-squares estimates are, under three assumptions about the residual."""

from enum import StrEnum

import numpy as np
from scipy.linalg import matmul_toeplitz

from crane_identification.estimation.autoregression import Autoregression, restricted_likelihood
from crane_identification.estimation.rows import Rows
from crane_model.base_parameters import reveal_rank


class Covariance(StrEnum):
    """What is assumed of the residual.

    CLASSICAL: white; its variance is its sum of squares over (rows - parameters).
    SAMPLE: white; its variance is the sample variance about its mean, as usual in robotics (EMPS).
    CORRELATED: an autoregressive process of its own in each joint.
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
    """Covariance B (Σ ΦᵀW Γ WΦ) B (p, p), Γ the autocovariance of the noise of each joint.

    Γ is that of an autoregressive model fitted to the rows of the joint alone, scaled up where the
    weighted `residual` (n, j) is larger: then the joints contradict each other. On records of a
    hundred rows its intervals cover what they claim, where those of a kernel estimate (Newey and
    West) are up to twice too narrow.
    """
    runs = [np.flatnonzero(rows.run == run) for run in np.unique(rows.run)]
    meat = np.zeros_like(bread)
    for j in range(len(rows.joints)):
        used = rows.used[:, j]
        if not used.any():
            continue
        weight = np.where(used, weights[:, j], 0.0)
        columns, force = rows.matrix[:, j] * weight[:, None], rows.force[:, j] * weight
        own = list(reveal_rank(columns[used]).independent)
        noise = restricted_likelihood(
            _by_run(columns[:, own], runs), _by_run(force, runs), _by_run(used, runs)
        )
        power = float((residual[used, j] ** 2).mean())
        if noise is None or noise.variance < power:
            noise = Autoregression(np.ones(1) if noise is None else noise.polynomial, power)
        covariance = noise.autocovariance(max(len(run) for run in runs))
        for run in runs:
            meat += columns[run].T @ matmul_toeplitz(covariance[: len(run)], columns[run])
    return bread @ meat @ bread


def _by_run(values: np.ndarray, runs: list[np.ndarray]) -> np.ndarray:
    """(n, ...) to (runs, longest run, ...), padded with zeros."""
    longest = max(len(run) for run in runs)
    out = np.zeros((len(runs), longest, *values.shape[1:]), dtype=values.dtype)
    for i, run in enumerate(runs):
        out[i, : len(run)] = values[run]
    return out
