"""Is anything left in the residual beyond noise, as the scatter between periods shows it?

The F-test of lack of fit against pure error (Fisher 1922), for correlated noise: the power of the
residual of the averaged force is compared with that of its noise, and each counts as many degrees
of freedom as it has independent samples (Satterthwaite 1946).
"""

from dataclasses import dataclass

import numpy as np
from scipy.linalg import matmul_toeplitz
from scipy.ndimage import uniform_filter1d
from scipy.stats import f as fisher

from crane_identification.estimation.rows import Rows, solve
from crane_identification.preparation.averaging import LOCAL
from crane_identification.signals.decimate import UNFILTERED


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


def independent_samples(
    deviation: np.ndarray, used: np.ndarray, filtered: np.ndarray = UNFILTERED
) -> np.ndarray:
    """How many of n samples (j,) are independent: tr(C)²/tr(C²) of their covariance C.

    From deviations (M, n, j) from the mean of M periods, over the `used` (n, j) samples: C has
    their variance, which changes over the period, and one autocorrelation, up to the lag at which
    it is lost in its own uncertainty; but at least that which a filter gives to white noise,
    `filtered` (lags,). Where joints turn back the periods differ most, so that a few samples may
    hold most of the power, and the others tell nothing beside them. The chance by which the
    variance, seen in few samples, is uneven too is taken out of C².
    """
    count, samples, joints = deviation.shape
    length = 2 * samples
    window = max(int(LOCAL * samples), 1)
    overlap = np.maximum(1.0 - np.arange(samples) / window, 0.0)
    masked = np.where(used, deviation, 0.0)
    size = np.sqrt(_local_power(masked, used, window))
    scaled = np.divide(
        masked, size, out=np.zeros_like(masked), where=np.broadcast_to(size > 0.0, masked.shape)
    )
    products = np.fft.irfft((np.abs(np.fft.rfft(scaled, length, axis=1)) ** 2).sum(axis=0), axis=0)
    pairs, power = (
        np.fft.irfft(np.abs(np.fft.rfft(values, length, axis=0)) ** 2, axis=0)[:samples]
        for values in (used.astype(float), np.where(used, size**2, 0.0))
    )
    pairs = np.round(pairs)
    out = np.ones(joints)
    for j in range(joints):
        present = pairs[:, j] > 0
        correlation = np.zeros(samples)
        correlation[present] = products[:samples, j][present] / pairs[present, j]
        if not correlation[0] > 0.0:
            continue
        correlation /= correlation[0]
        noise = 2.0 / np.sqrt(np.maximum((count - 1) * pairs[:, j], 1.0))
        lost = np.flatnonzero(np.abs(correlation) < noise)
        last = int(lost[0]) if len(lost) else samples
        alike = correlation**2
        alike[last:] = 0.0
        known = min(len(filtered), samples)
        alike[:known] = np.maximum(alike[:known], filtered[:known] ** 2)
        alike[1:] *= 2.0  # lags to both sides
        # A variance from f degrees of freedom has the relative variance 2/f.
        chance = 2.0 * (overlap @ alike) / window / (count - 1) * overlap
        total = (size[used[:, j], j] ** 2).sum()
        out[j] = total**2 / (power[:, j] / (1.0 + chance) @ alike)
    return out


def _local_power(masked: np.ndarray, used: np.ndarray, window: int) -> np.ndarray:
    """Mean square (n, j) of deviations (M, n, j) in a window around each sample, 0 if none."""
    near = uniform_filter1d((masked**2).mean(axis=0), window, axis=0, mode="wrap")
    share = uniform_filter1d(used.astype(float), window, axis=0, mode="wrap")
    return np.divide(near, share, out=np.zeros_like(near), where=share > 0.5 / window)


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
