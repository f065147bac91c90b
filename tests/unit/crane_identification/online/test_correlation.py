"""The factor of correlated residuals against the processes that they come from."""

import numpy as np
import pytest

from crane_identification.online.recursion import ResidualCorrelation

LONG = 40_000
LAGS = 40


def factor(residual: np.ndarray, used: np.ndarray | None = None) -> float:
    correlation = ResidualCorrelation(1, LAGS)
    used = np.ones(len(residual), dtype=bool) if used is None else used
    for e, u in zip(residual, used, strict=True):
        correlation.add(np.array([e]), np.array([u]))
    return float(correlation.factors()[0])


def autoregression(coefficient: float, seed: int = 0) -> np.ndarray:
    rng = np.random.default_rng(seed)
    out = np.zeros(LONG)
    for k in range(1, LONG):
        out[k] = coefficient * out[k - 1] + rng.standard_normal()
    return out


@pytest.mark.parametrize("coefficient", [0.0, 0.5, 0.8])
def test_of_a_first_order_process_it_is_known(coefficient: float) -> None:
    expected = (1 + coefficient) / (1 - coefficient)
    found = [factor(autoregression(coefficient, seed)[:6000]) for seed in range(5)]
    assert np.mean(found) == pytest.approx(expected, rel=0.2)


def test_what_is_anticorrelated_counts_as_white() -> None:
    assert factor(autoregression(-0.5)[:6000]) == 1.0


def test_of_windows_that_overlap_it_is_their_overlap() -> None:
    """White noise under Hann windows: an autoregression of low order would be nearly singular."""
    weights = np.hanning(11)[1:-1]
    noise = np.random.default_rng(0).standard_normal(12_000)
    expected = weights.sum() ** 2 / (weights**2).sum()
    assert factor(np.convolve(noise, weights, "valid")) == pytest.approx(expected, rel=0.25)


def test_gaps_do_not_hide_the_correlation() -> None:
    residual = autoregression(0.8)[:12_000]
    used = np.arange(len(residual)) % 50 < 30
    residual[~used] = 1e6
    assert factor(residual, used) == pytest.approx(9.0, rel=0.4)


def test_nothing_is_known_without_residuals() -> None:
    assert ResidualCorrelation(3, LAGS, 2.5).factors().tolist() == [2.5, 2.5, 2.5]


def test_an_interruption_separates_neighbours() -> None:
    correlation = ResidualCorrelation(1, LAGS)
    for e in np.random.default_rng(0).standard_normal(2000):
        for value in (e, e):
            correlation.add(np.array([value]), np.array([True]))
        correlation.interrupt()
    # pairs are equal, but nobody sees more than two in a row
    assert correlation.factors()[0] > 2.0


def test_the_first_poor_residuals_are_forgotten() -> None:
    poor = 1e3 * np.ones(50)
    white = np.random.default_rng(0).standard_normal(LONG)
    assert factor(np.concatenate([poor, white])) == pytest.approx(1.0, abs=0.25)
