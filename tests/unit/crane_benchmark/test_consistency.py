"""Errors that stay from sample to sample, as large as they are said to be, or not."""

import numpy as np
import pytest
from scipy.signal import lfilter

from crane_benchmark.observing.consistency import in_band, independent

SAMPLES, RUNS = 4000, 200
STAY = 0.98  # of an error from one sample to the next
RNG = np.random.default_rng(8)


def errors() -> np.ndarray:
    """(RUNS, SAMPLES) of unit variance."""
    noise = RNG.normal(size=(RUNS, SAMPLES)) * np.sqrt(1.0 - STAY**2)
    noise[:, 0] /= np.sqrt(1.0 - STAY**2)
    return np.asarray(lfilter([1.0], [1.0, -STAY], noise, axis=1))


def test_errors_that_stay_count_as_fewer() -> None:
    squared = errors() ** 2
    found = np.median([independent(one) for one in squared])
    exact = SAMPLES * (1.0 - STAY**2) / (1.0 + STAY**2)  # squares are alike by the square of it
    assert 0.7 * exact < found < 1.6 * exact
    assert independent(np.ones(10)) == 1.0
    assert independent(RNG.normal(size=SAMPLES) ** 2) == pytest.approx(SAMPLES, rel=0.1)


@pytest.mark.parametrize(
    ("size", "low", "high"), [(1.0, 0.87, 0.99), (1.4, 0.0, 0.2), (0.6, 0.0, 0.2)]
)
def test_the_band_holds_runs_whose_errors_are_as_said(size: float, low: float, high: float) -> None:
    squared = (size * errors()) ** 2 + (size * errors()) ** 2
    share = np.mean([in_band(one, 2) for one in squared])
    assert low <= share <= high
