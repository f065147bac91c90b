"""How uncertain least-squares estimates are, under three assumptions about the residual."""

import numpy as np
from scipy.linalg import helmert, matmul_toeplitz

from crane_identification.estimation.autoregression import Autoregression, restricted_likelihood
from crane_identification.estimation.lack_of_fit import LackOfFit, lack_of_fit
from crane_identification.estimation.rows import Rows
from crane_identification.options import Covariance
from crane_model.base_parameters import reveal_rank

NOISE = 0.01
"""Probability of noise leaving such a residual, above which it is taken for noise."""


def white(residual: np.ndarray, bread: np.ndarray, assumption: Covariance) -> np.ndarray:
    """Covariance (p, p) of the estimate for a white weighted residual (N,).

    `bread` is (ΦᵀW²Φ)⁻¹.
    """
    if assumption is Covariance.SAMPLE:
        return bread * np.var(residual, ddof=1)
    return bread * (residual @ residual) / (len(residual) - len(bread))


def meat(rows: Rows, weights: np.ndarray, values: np.ndarray, assumption: Covariance) -> np.ndarray:
    """Σ ΦᵀW Γ WΦ (p, p), with Γ the autocovariance of the noise that `assumption` gives."""
    unit = np.eye(len(values))
    spread = np.broadcast_to(weights, rows.force.shape)
    residual = spread * rows.residual(values)
    if assumption is Covariance.CORRELATED:
        return correlated(rows, spread, residual, unit, lack_of_fit(rows, values))
    columns = rows.stacked * spread[rows.used][:, None]
    return columns.T @ columns * white(residual[rows.used], unit, assumption)[0, 0]


def correlated(
    rows: Rows, weights: np.ndarray, residual: np.ndarray, bread: np.ndarray, left: LackOfFit
) -> np.ndarray:
    """Covariance B (Σ ΦᵀW Γ WΦ) B (p, p), Γ the autocovariance of the noise of each joint.

    Γ is that of an autoregressive model. Where the residual is noise, as the test of lack of fit
    sees it, the model is that of the scatter between periods before the parallel filter: what the
    filter does to noise is known, and found anew from fifty rows it would make standard deviations
    a matter of chance. Its variance is that of scatter and residual together. Else the model is
    fitted to the rows of the joint alone, and scaled up where the weighted `residual` (n, j) is
    larger: then the joints contradict each other. On records of a hundred rows its intervals cover
    what they claim, where those of a kernel estimate (Newey and West) are up to twice too narrow.
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
        noise = _shown_by_scatter(rows, weight, left, j)
        if noise is None:
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


def _shown_by_scatter(
    rows: Rows, weight: np.ndarray, left: LackOfFit, j: int
) -> Autoregression | None:
    """The noise of the weighted mean force of joint j; None if the residual is not that noise."""
    if not left.p_value[j] > NOISE:
        return None
    longest = max(one.shape[1] for one in rows.scatter)
    deviations, used = [], []
    for run, deviation in enumerate(rows.scatter):
        own = rows.run == run
        padding = (0, longest - deviation.shape[1])
        # The deviations of M periods hold M - 1 independent ones, each of the variance of a period.
        contrasts = helmert(len(deviation)) @ deviation[:, :, j] / np.sqrt(len(deviation))
        deviations.append(np.pad(contrasts * weight[own], ((0, 0), padding)))
        used.append(np.tile(np.pad(rows.used[own, j], padding), (len(contrasts), 1)))
    force, known = np.concatenate(deviations), np.concatenate(used)
    noise = restricted_likelihood(np.zeros((*force.shape, 0)), force, known, rows.filtered)
    if noise is None:
        return None
    freedom, of_noise = left.freedom[j], left.noise_freedom[j]
    pooled = (of_noise + freedom * left.ratio[j]) / (of_noise + freedom)
    return noise._replace(variance=noise.variance * float(pooled))


def _by_run(values: np.ndarray, runs: list[np.ndarray]) -> np.ndarray:
    """(n, ...) to (runs, longest run, ...), padded with zeros."""
    longest = max(len(run) for run in runs)
    out = np.zeros((len(runs), longest, *values.shape[1:]), dtype=values.dtype)
    for i, run in enumerate(runs):
        out[i, : len(run)] = values[run]
    return out
