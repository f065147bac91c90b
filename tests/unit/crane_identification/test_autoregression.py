import warnings

import numpy as np
import pytest
from scipy.linalg import toeplitz
from scipy.optimize import minimize_scalar
from scipy.signal import lfilter
from statsmodels.tsa.arima.model import ARIMA

from crane_identification.estimation.autoregression import (
    UNFILTERED,
    Autoregression,
    restricted_likelihood,
)

POLYNOMIAL = np.array([1.0, -1.2, 0.5])


def process(n: int, seed: int, polynomial: np.ndarray = POLYNOMIAL) -> np.ndarray:
    noise = np.random.default_rng(seed).normal(size=n + 500)
    return lfilter([1.0], polynomial, noise)[500:]


def fitted(
    values: np.ndarray,
    columns: np.ndarray | None = None,
    used: np.ndarray | None = None,
    filtered: np.ndarray = UNFILTERED,
) -> Autoregression:
    """The noise of runs (r, n), with columns (r, n, p) if any."""
    columns = np.zeros((*values.shape, 0)) if columns is None else columns
    used = np.ones(values.shape, dtype=bool) if used is None else used
    noise = restricted_likelihood(columns, values, used, filtered)
    assert noise is not None
    return noise


def test_without_columns_it_is_exact_maximum_likelihood() -> None:
    """Against the Kalman filter likelihood of statsmodels."""
    values = process(500, seed=1)
    expected = ARIMA(values, order=(2, 0, 0), trend="n").fit()
    noise = fitted(values[None])
    np.testing.assert_allclose(noise.polynomial[1:], -expected.arparams, atol=2e-3)
    innovations = noise.variance * np.prod(1 - reflections(noise.polynomial) ** 2)
    assert innovations == pytest.approx(expected.params[-1], rel=0.01)


def reflections(polynomial: np.ndarray) -> np.ndarray:
    """By stepping the polynomial down."""
    found = []
    while len(polynomial) > 1:
        last = polynomial[-1]
        found.append(last)
        polynomial = ((polynomial - last * polynomial[::-1]) / (1 - last**2))[:-1]
    return np.array(found)


def test_with_columns_it_is_the_restricted_likelihood_written_out() -> None:
    """One coefficient and the variance, against dense matrices."""
    n = 60
    columns = np.vander(np.linspace(-1, 1, n), 6)
    values = process(n, seed=21, polynomial=np.array([1.0, -0.7]))

    def cost(coefficient: float) -> float:
        inverse = np.linalg.inv(toeplitz(coefficient ** np.arange(n)))
        information = columns.T @ inverse @ columns
        rest = values - columns @ np.linalg.solve(information, columns.T @ inverse @ values)
        logs = np.linalg.slogdet(information)[1] - np.linalg.slogdet(inverse)[1]
        return (n - 6) * np.log(rest @ inverse @ rest) + logs

    expected = minimize_scalar(cost, bounds=(0.0, 0.98), method="bounded").x
    noise = fitted(values[None], columns[None])
    assert len(noise.polynomial) == 2
    assert -noise.polynomial[1] == pytest.approx(expected, abs=5e-3)


def test_columns_do_not_bias_it() -> None:
    """Many short records with many columns, which take away most of the slow noise."""
    columns = np.vander(np.linspace(-1, 1, 80), 12)
    basis = np.linalg.qr(columns)[0]
    correlation, naive = [], []
    for seed in range(60):
        values = process(80, seed, polynomial=np.array([1.0, -0.8]))
        covariance = fitted(values[None], columns[None]).autocovariance(2)
        correlation.append(covariance[1] / covariance[0])
        rest = values - basis @ (basis.T @ values)
        naive.append(rest[1:] @ rest[:-1] / (rest @ rest))
    assert np.median(correlation) == pytest.approx(0.8, abs=0.06)
    assert np.median(naive) < 0.6


def test_gaps_do_not_bias_it() -> None:
    """Every tenth sample missing; what stands there is not looked at."""
    values = process(20_000, seed=3)[None]
    used = np.ones(values.shape, dtype=bool)
    used[:, ::10] = False
    noise = fitted(values, used=used)
    np.testing.assert_allclose(noise.polynomial[:3], POLYNOMIAL, atol=0.05)
    spoilt = np.where(used, values, np.nan)
    np.testing.assert_array_equal(fitted(spoilt, used=used).polynomial, noise.polynomial)


FILTER = np.array([0.4, 1.0, 0.4])
FILTERED = np.convolve(FILTER, FILTER)[2:] / np.convolve(FILTER, FILTER)[2]


def test_behind_a_filter_it_is_the_noise_before_it() -> None:
    values = lfilter(FILTER, [1.0], process(20_000, seed=7))
    noise = fitted(values[None], filtered=FILTERED)
    np.testing.assert_allclose(noise.polynomial, POLYNOMIAL, atol=0.03)
    sample = [np.mean(values[lag:] * values[: len(values) - lag]) for lag in range(8)]
    np.testing.assert_allclose(noise.autocovariance(8), sample, atol=0.05 * sample[0])


def test_behind_a_filter_the_likelihood_is_exact() -> None:
    """White noise before it, records no longer than the memory, against dense matrices."""
    covariance = toeplitz(np.pad(FILTERED, (0, 5)))
    values = np.linalg.cholesky(covariance) @ np.random.default_rng(8).normal(size=(8, 30))
    noise = fitted(values.T, filtered=FILTERED)
    assert len(noise.polynomial) == 1
    expected = np.einsum("nr,nm,mr->", values, np.linalg.inv(covariance), values) / values.size
    assert noise.variance == pytest.approx(expected)


def test_runs_are_not_connected() -> None:
    whole = process(10_000, seed=4)
    runs = np.stack([whole[:5000], -whole[5000:]])
    np.testing.assert_allclose(fitted(runs).polynomial, POLYNOMIAL, atol=0.05)


def test_white_noise_needs_no_coefficients() -> None:
    noise = fitted(3.0 * np.random.default_rng(5).normal(size=(1, 5000)))
    assert len(noise.polynomial) == 1
    assert noise.variance == pytest.approx(9.0, rel=0.05)


def test_nothing_is_left_over() -> None:
    columns = np.vander(np.linspace(-1, 1, 8), 8)[None]
    used = np.ones((1, 8), dtype=bool)
    assert restricted_likelihood(columns, columns.sum(axis=2), used) is None


@pytest.mark.parametrize(
    "values",
    [np.zeros(50), np.ones(50), np.arange(50.0), np.tile([1.0, -1.0], 25), np.ones(3)],
    ids=["zeros", "constant", "ramp", "alternating", "short"],
)
def test_degenerate_noise_gives_a_finite_stable_model(values: np.ndarray) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        noise = fitted(values[None])
    assert np.isfinite(noise.variance)
    assert (np.abs(np.roots(noise.polynomial)) < 1.0).all()


def test_autocovariance_of_first_order_is_geometric() -> None:
    noise = Autoregression(np.array([1.0, -0.9]), 4.0)
    np.testing.assert_allclose(noise.autocovariance(60), 4.0 * 0.9 ** np.arange(60), atol=1e-12)


def test_autocovariance_is_that_of_the_process() -> None:
    values = process(400_000, seed=6)
    sample = [np.mean(values[lag:] * values[: len(values) - lag]) for lag in range(8)]
    covariance = Autoregression(POLYNOMIAL, sample[0]).autocovariance(8)
    np.testing.assert_allclose(covariance, sample, atol=0.03 * sample[0])
