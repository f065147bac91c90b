"""Autocorrelation of the noise in a regression, by an autoregressive model of it.

The residual of a regression is not the noise: what the columns can explain of the noise is gone,
and with few rows that is most of its low frequencies. Restricted maximum likelihood (Patterson and
Thompson 1971) uses only what no column can explain, and so has no such bias.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.linalg import LinAlgError, cholesky, matmul_toeplitz
from scipy.ndimage import uniform_filter1d
from scipy.optimize import minimize
from scipy.stats import f as fisher

from crane_identification.estimation.regression import Rows, solve
from crane_identification.preparation.run import LOCAL
from crane_identification.signals.decimate import UNFILTERED

HIGHEST_ORDER = 4
ROWS_PER_ORDER = 10  # that no column explains; fewer do not carry another coefficient
LARGEST_REFLECTION = 0.98  # keeps the memory of the model finite
GRADIENT = 0.05  # of the log-likelihood at which the search ends; a difference of 1 says nothing
FORCE_ROUNDING_POWER = 1e-24  # share of the force's sum of squares below which the rest is rounding
REFLECTIONS = np.linspace(-0.95, 0.95, 39)
PREDICTION_SAMPLES = 2 * HIGHEST_ORDER
"""Samples from which filtered noise is predicted, which has no order of its own."""

Predictors = tuple[list[np.ndarray], np.ndarray]
"""Polynomials that predict a sample from 0, 1, ... before it, and the variances of their errors."""


class Autoregression(NamedTuple):
    """Noise whitened by `polynomial` (order + 1,), 1 + a1 z⁻¹ + ..., with the given `variance`.

    Or such noise, and its variance, behind a filter: `filtered` (lags,) is the autocorrelation that
    the filter alone gives to white noise.
    """

    polynomial: np.ndarray
    variance: float
    filtered: np.ndarray = UNFILTERED

    def autocovariance(self, lags: int) -> np.ndarray:
        """Autocovariance of the filtered noise at lags 0, 1, ...: (lags,)."""
        points = _points(lags)
        return np.fft.irfft(self.spectrum(points), points)[:lags]

    def spectrum(self, points: int) -> np.ndarray:
        """Power spectrum (points / 2 + 1,) of the noise behind its filter, its mean `variance`."""
        power = _power(self.filtered, points)
        power = power / np.abs(np.fft.rfft(self.polynomial, points)) ** 2
        return self.variance * power / np.fft.irfft(power, points)[0]


def restricted_likelihood(
    columns: np.ndarray, force: np.ndarray, used: np.ndarray, filtered: np.ndarray = UNFILTERED
) -> Autoregression | None:
    """The noise of force = columns × parameters + noise; None if the columns explain all of it.

    `columns` (r, n, p), linearly independent, `force` and `used` (r, n), of r runs of n samples;
    rows are whitened by as many used samples as stand directly before them. Order by Schwarz
    (1978). `filtered` (lags,): the autocorrelation that a filter has given to white noise.
    """
    models = _models(columns, force, used, filtered)
    return min(models, key=lambda model: model.schwarz).noise if models else None


def autocovariances(
    columns: np.ndarray, force: np.ndarray, used: np.ndarray, lags: int, power: float
) -> tuple[np.ndarray, np.ndarray]:
    """Autocovariances (lags,) of the noise in the same regression: most probable, and cautious.

    Few rows do not show which model is true, and the most probable one may put little power just
    where the columns have theirs. The cautious one depends less on that choice: the spectra of
    all orders are averaged by their probability (Schwarz), order 1 over all its coefficients, and
    no frequency has less power than white noise as strong as the residual. If the columns explain
    all of the force, both are white noise of this `power`.
    """
    models = _models(columns, force, used, UNFILTERED)
    if not models:
        white = np.where(np.arange(lags) == 0, power, 0.0)
        return white, white
    points = _points(lags)
    spectra = [model.noise.spectrum(points) for model in models]
    criteria = [model.schwarz for model in models]
    likely, least = spectra[int(np.argmin(criteria))], spectra[0]
    if (likelihood := models[0].likelihood) is not None:
        first = _Likelihood(likelihood.values, used, 1, UNFILTERED)
        searched = np.arctanh(REFLECTIONS / LARGEST_REFLECTION)[:, np.newaxis]
        costs = np.array([first.cost(point) for point in searched])
        of_coefficient = [first.noise(point).spectrum(points) for point in searched]
        averaged = _shares(costs) @ np.array(of_coefficient)
        spectra[1:2], criteria[1:2] = [averaged], [float(costs.min() + np.log(first.free))]
    cautious = np.maximum(_shares(np.array(criteria)) @ np.array(spectra), least)
    return np.fft.irfft(likely, points)[:lags], np.fft.irfft(cautious, points)[:lags]


def _shares(costs: np.ndarray) -> np.ndarray:
    """Probabilities of models by -2 log of their likelihoods."""
    shares = np.exp(-0.5 * (costs - costs.min()))
    return np.asarray(shares / shares.sum())


class _Model(NamedTuple):
    """Noise of an order by maximum likelihood, and its criterion by Schwarz (1978).

    Without a likelihood the residual is rounding.
    """

    noise: Autoregression
    schwarz: float
    likelihood: "_Likelihood | None"


def _models(
    columns: np.ndarray, force: np.ndarray, used: np.ndarray, filtered: np.ndarray
) -> list[_Model]:
    """Order 0, 1, ...; none if the columns explain all of the force."""
    samples, explained = int(used.sum()), columns.shape[2]
    free = samples - explained
    if free <= 0:
        return []
    basis, rest = np.zeros_like(columns), np.zeros_like(force)
    basis[used] = np.linalg.qr(columns[used])[0]
    rest[used] = force[used] - basis[used] @ (basis[used].T @ force[used])
    power = float((rest**2).sum())
    if power <= FORCE_ROUNDING_POWER * float((force[used] ** 2).sum()):
        return [_Model(Autoregression(np.ones(1), power / free, filtered), 0.0, None)]
    values = np.concatenate([basis, rest[..., np.newaxis]], axis=2)
    found, start = [], np.zeros(0)
    for order in range(min(HIGHEST_ORDER, free // ROWS_PER_ORDER) + 1):
        likelihood = _Likelihood(values, used, order, filtered)
        if order:
            start = minimize(likelihood.cost, [*start, 0.0], options={"gtol": GRADIENT}).x
        schwarz = likelihood.cost(start) + order * np.log(free)
        found.append(_Model(likelihood.noise(start), schwarz, likelihood))
    return found


class _Likelihood:
    """-2 log restricted likelihood of an order, as a function of its reflection coefficients.

    All sums over samples are done once: values × values at every pair of lags, for the samples
    with 0, 1, ... used samples before them, up to the memory.
    """

    def __init__(
        self, values: np.ndarray, used: np.ndarray, order: int, filtered: np.ndarray
    ) -> None:
        self.values, self.filtered = values, filtered
        self.free = int(used.sum()) - (values.shape[2] - 1)
        self.counts, self.products = [], []
        self.predictors = _predictors if len(filtered) == 1 else _behind(filtered)
        memory = order if len(filtered) == 1 else PREDICTION_SAMPLES
        before = _used_before(used, memory)
        for m in range(memory + 1):
            run, sample = np.nonzero(used & (before == m))
            lagged = np.stack([values[run, sample - lag] for lag in range(m + 1)])
            self.counts.append(len(run))
            self.products.append(np.einsum("lnk,mnq->lmkq", lagged, lagged, optimize=True))

    def cost(self, search: np.ndarray) -> float:
        """The value at reflection coefficients LARGEST_REFLECTION tanh(search)."""
        predictors = self.predictors(search)
        try:
            factor = self._factor(predictors)
        except LinAlgError:  # rounding at the edge of stability
            return np.inf
        variances = predictors[1]
        diagonal = np.log(np.diag(factor))
        scale = np.log(variances / variances[-1]) @ np.array(self.counts)
        return float(2 * self.free * diagonal[-1] + 2 * diagonal[:-1].sum() + scale)

    def noise(self, search: np.ndarray) -> Autoregression:
        """The model at these reflection coefficients, with the variance that fits best."""
        predictors = self.predictors(search)
        rest = float(self._factor(predictors)[-1, -1] ** 2)  # that no whitened column explains
        variance = rest / self.free / predictors[1][-1]
        return Autoregression(_predictors(search)[0][-1], variance, self.filtered)

    def _factor(self, predictors: Predictors) -> np.ndarray:
        polynomials, variances = predictors
        total = sum(
            np.einsum("l,m,lmkq->kq", a, a, product) * variances[-1] / variance
            for a, product, variance in zip(polynomials, self.products, variances, strict=True)
        )
        return cholesky(total, lower=True)


def predictors_of(autocovariance: np.ndarray) -> Predictors:
    """Those of order 0 to lags - 1, of noise with this `autocovariance` (lags,) (Levinson)."""
    polynomials, variances = [np.ones(1)], [float(autocovariance[0])]
    for order in range(1, len(autocovariance)):
        longer = np.append(polynomials[-1], 0.0)
        reflection = -float(longer @ autocovariance[order::-1]) / variances[-1]
        polynomials.append(longer + reflection * longer[::-1])
        variances.append(variances[-1] * (1 - reflection**2))
    return polynomials, np.array(variances)


def _predictors(search: np.ndarray) -> Predictors:
    """Those of order 0 to that of the model, by its reflection coefficients."""
    polynomials, variances = [np.ones(1)], [1.0]
    for reflection in LARGEST_REFLECTION * np.tanh(search):
        longer = np.append(polynomials[-1], 0.0)
        polynomials.append(longer + reflection * longer[::-1])
        variances.append(variances[-1] * (1 - reflection**2))
    return polynomials, np.array(variances)


def _points(lags: int) -> int:
    """Frequencies on which noise of so many lags is evaluated."""
    return 8 * (lags + 64)


def _power(filtered: np.ndarray, points: int) -> np.ndarray:
    """Spectrum (points / 2 + 1,) of an autocorrelation of one side.

    Not below zero, which the cut tail may leave where nothing passes the filter.
    """
    return np.maximum(2.0 * np.fft.rfft(filtered, points).real - filtered[0], 0.0)


def _behind(filtered: np.ndarray) -> Callable[[np.ndarray], Predictors]:
    """Those of order 0 to PREDICTION_SAMPLES of such a model behind a filter."""

    def predictors(search: np.ndarray) -> Predictors:
        model = Autoregression(_predictors(search)[0][-1], 1.0, filtered)
        return predictors_of(model.autocovariance(PREDICTION_SAMPLES + 1))

    return predictors


def _used_before(used: np.ndarray, highest: int) -> np.ndarray:
    """(r, n): number of used samples directly before each, up to `highest`."""
    count = np.zeros(used.shape, dtype=int)
    unbroken = np.ones(used.shape, dtype=bool)
    for lag in range(1, highest + 1):
        earlier = np.zeros_like(used)
        earlier[:, lag:] = used[:, : used.shape[1] - lag]
        unbroken &= earlier
        count += unbroken
    return count


# Is anything left in the residual beyond noise, as the scatter between periods shows it?
#
# The F-test of lack of fit against pure error (Fisher 1922), for correlated noise: the power of the
# residual of the averaged force is compared with that of its noise, and each counts as many degrees
# of freedom as it has independent samples (Satterthwaite 1946).


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
        used, freedom_of_scatter = rows.used[rows.run == run], len(deviation) - 1
        mean_noise = (
            np.where(used, deviation**2, 0.0).sum(axis=(0, 1)) / freedom_of_scatter / len(deviation)
        )
        independent = independent_samples(deviation, used, rows.filtered)
        noise += mean_noise
        variance += mean_noise**2 / independent
        of_noise += mean_noise**2 / independent / freedom_of_scatter
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
