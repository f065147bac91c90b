import numpy as np
import pytest
from scipy.signal import lfilter
from statsmodels.regression.linear_model import burg as statsmodels_burg

from crane_identification.estimation.autoregression import autocorrelation, burg

POLYNOMIAL = np.array([1.0, -1.2, 0.5])


def process(n: int, seed: int, polynomial: np.ndarray = POLYNOMIAL) -> np.ndarray:
    noise = np.random.default_rng(seed).normal(size=n + 500)
    return lfilter([1.0], polynomial, noise)[500:]


def all_used(values: np.ndarray) -> np.ndarray:
    return np.ones(values.shape, dtype=bool)


def test_equals_burg_of_statsmodels_without_gaps() -> None:
    values = process(2000, seed=1)[None]
    found = burg(values, all_used(values), highest=2)
    expected, _ = statsmodels_burg(values[0], order=2, demean=False)
    np.testing.assert_allclose(-found[1:], expected, rtol=1e-10)


def test_gaps_do_not_bias_it() -> None:
    """Every tenth sample missing shortens the products but leaves their mean."""
    values = process(50_000, seed=2)[None]
    used = np.ones(values.shape, dtype=bool)
    used[:, ::10] = False
    np.testing.assert_allclose(burg(values, used, highest=2), POLYNOMIAL, atol=0.03)
    spoilt = np.where(used, values, 1e6)
    np.testing.assert_array_equal(burg(spoilt, used), burg(values, used))


def test_runs_are_not_connected() -> None:
    whole = process(20_000, seed=3)
    runs = np.stack([whole[:10_000], -whole[10_000:]])
    np.testing.assert_allclose(burg(runs, all_used(runs), highest=2), POLYNOMIAL, atol=0.03)


def test_white_noise_needs_no_model() -> None:
    values = np.random.default_rng(4).normal(size=(1, 5000))
    assert np.abs(burg(values, all_used(values))[1:]).max(initial=0.0) < 0.05


@pytest.mark.parametrize(
    "values", [np.zeros((1, 50)), np.ones((1, 50)), np.arange(50.0)[None], np.ones((2, 1))]
)
def test_degenerate_residuals_give_stable_models(values: np.ndarray) -> None:
    polynomial = burg(values, all_used(values))
    assert np.isfinite(polynomial).all()
    assert (np.abs(np.roots(polynomial)) < 1.0).all()


def test_autocorrelation_of_first_order_is_geometric() -> None:
    np.testing.assert_allclose(
        autocorrelation(np.array([1.0, -0.9]), 60), 0.9 ** np.arange(60), atol=1e-12
    )


def test_autocorrelation_is_that_of_the_process() -> None:
    values = process(400_000, seed=5)
    sample = [np.mean(values[lag:] * values[: len(values) - lag]) for lag in range(8)]
    np.testing.assert_allclose(
        autocorrelation(POLYNOMIAL, 8), np.array(sample) / sample[0], atol=0.02
    )
