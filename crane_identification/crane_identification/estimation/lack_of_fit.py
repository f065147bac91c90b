"""Is anything left in the residual beyond noise, as the scatter between periods shows it?

The F-test of lack of fit against pure error (Fisher 1922), for correlated noise: the power of the
residual of the averaged force is compared with that of its noise, and each counts as many degrees
of freedom as it has independent samples (Satterthwaite 1946).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import f as fisher

from crane_identification.averaging import independent_samples
from crane_identification.estimation.rows import Rows
from crane_identification.estimation.solving import solve


@dataclass(frozen=True)
class LackOfFit:
    """Per joint (j,): power of the residual over what noise alone leaves of it, and how likely
    noise alone gives that much. NaN where no period was repeated.
    """

    joints: tuple[str, ...]
    ratio: np.ndarray
    p_value: np.ndarray


def lack_of_fit(rows: Rows, values: np.ndarray, scatter: Sequence[np.ndarray]) -> LackOfFit:
    """Test of the residual of `values` (p,) on `rows`.

    `scatter`: per run, deviations (M, n, j) of the force of each period from their mean, filtered
    as the rows.
    """
    residual = rows.residual(values)
    absorbed = _absorbed(rows, residual)
    ratio, p_value = np.full((2, len(rows.joints)), np.nan)
    repeated = [run for run, deviation in enumerate(scatter) if len(deviation) > 1]
    if repeated:
        inside = np.isin(rows.run, repeated)
        power = (residual[inside] ** 2).sum(axis=0)
        noise, variance, mean_variance = np.zeros((3, len(rows.joints)))
        for run in repeated:
            deviation, used = scatter[run], rows.used[rows.run == run]
            count = len(deviation)
            own = np.where(used, deviation**2, 0.0).sum(axis=(0, 1)) / (count - 1) / count
            independent = independent_samples(deviation, used)
            noise += own
            mean_variance += own**2 / independent
            variance += own**2 / independent / (count - 1)
        left = 1.0 - absorbed
        seen = (noise > 0.0) & (left > 0.0)
        ratio[seen] = (power / noise)[seen] / left[seen]
        freedom, of_noise = (noise[seen] ** 2 / v[seen] for v in (mean_variance, variance))
        p_value[seen] = fisher.sf(ratio[seen], left[seen] * freedom, of_noise)
    return LackOfFit(rows.joints, ratio, p_value)


def _absorbed(rows: Rows, residual: np.ndarray) -> np.ndarray:
    """Share (j,) of the noise of each joint that the parameters take up: mean leverage."""
    size = rows.rms(residual)
    weights = np.divide(1.0, size, out=np.ones_like(size), where=size > 0.0)
    matrix = rows.matrix * weights[:, np.newaxis]
    bread = solve(matrix[rows.used], np.zeros(rows.samples)).bread
    leverage = np.einsum("njk,kl,njl->nj", matrix, bread, matrix)
    share = np.where(rows.used, leverage, 0.0).sum(axis=0)
    return share / np.maximum(rows.used.sum(axis=0), 1)
