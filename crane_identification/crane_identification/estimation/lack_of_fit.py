"""Is anything left in the residual beyond noise, as the scatter between periods shows it?

The F-test of lack of fit against pure error (Fisher 1922), for correlated noise: the power of the
residual of the averaged force is compared with that of its noise, and each counts as many degrees
of freedom as it has independent samples (Satterthwaite 1946).
"""

from dataclasses import dataclass

import numpy as np
from scipy.linalg import matmul_toeplitz
from scipy.stats import f as fisher

from crane_identification.estimation.rows import Rows
from crane_identification.estimation.solving import solve
from crane_identification.preparation.averaging import independent_samples


@dataclass(frozen=True)
class LackOfFit:
    """Per joint (j,), NaN where no period was repeated.

    `ratio`: power of the residual over what noise alone leaves of it. `p_value`: how likely noise
    alone gives as much. `freedom` and `noise_freedom`: independent samples of either.
    """

    joints: tuple[str, ...]
    ratio: np.ndarray
    p_value: np.ndarray
    freedom: np.ndarray
    noise_freedom: np.ndarray


def lack_of_fit(rows: Rows, values: np.ndarray) -> LackOfFit:
    """Test of the residual of `values` (p,) on `rows` against their scatter."""
    residual = rows.residual(values)
    joints = len(rows.joints)
    ratio, p_value, freedom, noise_freedom = np.full((4, joints), np.nan)
    if not rows.repeated:
        return LackOfFit(rows.joints, ratio, p_value, freedom, noise_freedom)
    noise, variance, of_noise = np.zeros((3, joints))
    for run, deviation in enumerate(rows.scatter):
        used, others = rows.used[rows.run == run], len(deviation) - 1
        mean_noise = np.where(used, deviation**2, 0.0).sum(axis=(0, 1)) / others / len(deviation)
        independent = independent_samples(deviation, used, rows.filtered)
        noise += mean_noise
        variance += mean_noise**2 / independent
        of_noise += mean_noise**2 / independent / others
    left = 1.0 - _absorbed(rows, residual)
    seen = (noise > 0.0) & (left > 0.0)
    ratio[seen] = (residual**2).sum(axis=0)[seen] / noise[seen] / left[seen]
    freedom[seen] = (left * noise**2)[seen] / variance[seen]
    noise_freedom[seen] = noise[seen] ** 2 / of_noise[seen]
    p_value[seen] = fisher.sf(ratio[seen], freedom[seen], noise_freedom[seen])
    return LackOfFit(rows.joints, ratio, p_value, freedom, noise_freedom)


def _absorbed(rows: Rows, residual: np.ndarray) -> np.ndarray:
    """Share (j,) of the noise of each joint that the parameters take up.

    Of white noise the mean leverage; of filtered noise more, whose power lies where the columns
    have theirs. With H = ΦBΦᵀ and R the correlation of the rows, tr(2HR - HRH) over tr(R).
    """
    size = rows.rms(residual)
    weights = np.divide(1.0, size, out=np.ones_like(size), where=size > 0.0)
    matrix = np.where(rows.used[..., np.newaxis], rows.matrix * weights[:, np.newaxis], 0.0)
    bread = solve(matrix[rows.used], np.zeros(rows.samples)).bread
    smeared = np.empty_like(matrix)
    for run in (rows.run == number for number in np.unique(rows.run)):
        lags = np.zeros(run.sum())
        lags[: len(rows.filtered)] = rows.filtered[: len(lags)]
        flat = matrix[run].reshape(len(lags), -1)
        smeared[run] = matmul_toeplitz(lags, flat).reshape(matrix[run].shape)
    meat = bread @ np.einsum("njk,njl->kl", matrix, smeared) @ bread
    share = 2.0 * np.einsum("njk,kl,njl->j", matrix, bread, smeared)
    share -= np.einsum("njk,kl,njl->j", matrix, meat, matrix)
    return share / np.maximum(rows.used.sum(axis=0), 1)
