"""How uncertain least-squares estimates are, under three assumptions about the residual."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.linalg import helmert, matmul_toeplitz
from scipy.stats import norm as normal
from scipy.stats import t as student

from crane_identification.estimation.autoregression import (
    Autoregression,
    autocovariances,
    restricted_likelihood,
)
from crane_identification.estimation.lack_of_fit import LackOfFit, lack_of_fit
from crane_identification.estimation.rows import Rows
from crane_identification.options import Covariance
from crane_model.base_parameters import reveal_rank

NOISE = 0.01
"""Probability of noise leaving such a residual, above which it is taken for noise."""

COVERED = 0.975  # below the upper end of an interval of two standard deviations


def white(residual: np.ndarray, bread: np.ndarray, assumption: Covariance) -> np.ndarray:
    """Covariance (p, p) of the estimate for a white weighted residual (N,).

    `bread` is (ΦᵀW²Φ)⁻¹.
    """
    if assumption is Covariance.SAMPLE:
        return bread * np.var(residual, ddof=1)
    return bread * (residual @ residual) / (len(residual) - len(bread))


class NoiseOfJoint(NamedTuple):
    """What the noise of one joint does to the estimate.

    `meat` (p, p) is ΦᵀW Γ WΦ of its rows, Γ the autocovariance of the noise, and `freedom` the
    independent samples that Γ is known from. `likely` (p, p) is the same by the most probable model
    of the noise, without caution.
    """

    meat: np.ndarray
    likely: np.ndarray
    freedom: float


def meat(rows: Rows, weights: np.ndarray, values: np.ndarray, assumption: Covariance) -> np.ndarray:
    """Σ ΦᵀW Γ WΦ (p, p), with Γ the autocovariance of the noise that `assumption` gives."""
    spread = np.broadcast_to(weights, rows.force.shape)
    residual = spread * rows.residual(values)
    if assumption is Covariance.CORRELATED:
        joints = noise_of_joints(rows, spread, residual, lack_of_fit(rows, values))
        return np.sum([one.meat for one in joints], axis=0)
    columns = rows.stacked * spread[rows.used][:, None]
    unit = np.eye(len(values))
    return columns.T @ columns * white(residual[rows.used], unit, assumption)[0, 0]


def correlated(joints: Sequence[NoiseOfJoint], bread: np.ndarray) -> np.ndarray:
    """Covariance B (Σ meat) B (p, p), widened as the noise is known from few samples.

    Two standard deviations hold the truth in 95 % of all cases: by Student's t, with the degrees of
    freedom of each parameter from those of the joints that its variance comes from (Satterthwaite
    1946).
    """
    parts = np.array([bread @ one.meat @ bread for one in joints])
    variances = np.diagonal(parts, axis1=1, axis2=2)
    covariance, total = parts.sum(axis=0), variances.sum(axis=0)
    freedom = np.array([one.freedom for one in joints])
    uncertain = (variances**2 / freedom[:, np.newaxis]).sum(axis=0)
    known = np.divide(total**2, uncertain, out=np.full_like(total, np.inf), where=uncertain > 0.0)
    wider = student.ppf(COVERED, known) / normal.ppf(COVERED)
    widened: np.ndarray = covariance * wider * wider[:, np.newaxis]
    return widened


def noise_of_joints(
    rows: Rows, weights: np.ndarray, residual: np.ndarray, left: LackOfFit
) -> list[NoiseOfJoint]:
    """The noise of each joint that has used rows.

    Where the residual is noise, as the test of lack of fit sees it, its autocovariance is that of
    an autoregressive model of the scatter between periods before the parallel filter: what the
    filter does to noise is known, and found anew from fifty rows it would make standard deviations
    a matter of chance. Its variance is that of scatter and residual together. Else it is found from
    the rows of the joint alone, cautiously, and scaled up where the weighted `residual` (n, j) is
    larger: then the joints contradict each other. On records of a hundred rows such intervals cover
    what they claim, where those of a kernel estimate (Newey and West) are up to twice too narrow.
    """
    runs = [np.flatnonzero(rows.run == run) for run in np.unique(rows.run)]
    lags = max(len(run) for run in runs)
    found = []
    for j in range(len(rows.joints)):
        used = rows.used[:, j]
        if not used.any():
            continue
        weight = np.where(used, weights[:, j], 0.0)
        columns, force = rows.matrix[:, j] * weight[:, None], rows.force[:, j] * weight
        noise = _shown_by_scatter(rows, weight, left, j)
        if noise is not None:
            covariance = likely = noise.autocovariance(lags)
            freedom = float(left.freedom[j] + left.noise_freedom[j])
        else:
            own = list(reveal_rank(columns[used]).independent)
            regression = _by_run(columns[:, own], runs), _by_run(force, runs), _by_run(used, runs)
            power = float((residual[used, j] ** 2).mean())
            likely, covariance = (
                known * max(1.0, power / known[0]) if known[0] > 0.0 else known
                for known in autocovariances(*regression, lags, power)
            )
            free = 1.0 - len(own) / int(used.sum())
            freedom = free * _independent(covariance, [int(used[run].sum()) for run in runs])
        cautious, probable = (
            np.sum(
                [columns[r].T @ matmul_toeplitz(one[: len(r)], columns[r]) for r in runs], axis=0
            )
            for one in (covariance, likely)
        )
        found.append(NoiseOfJoint(cautious, probable, max(freedom, 1.0)))
    return found


def _independent(covariance: np.ndarray, samples: Sequence[int]) -> float:
    """How many of runs of so many samples are independent: tr(C)²/tr(C²) of their covariance C."""
    if not covariance[0] > 0.0:
        return float(sum(samples))
    squares = (covariance / covariance[0]) ** 2
    total = 0.0
    for count in samples:
        lags = np.arange(1, count)
        total += count + 2.0 * float(((count - lags) * squares[1:count]).sum())
    return sum(samples) ** 2 / total


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
