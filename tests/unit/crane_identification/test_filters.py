import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import signal

from crane_identification.signals.decimate import (
    decimate,
    decimation_factor,
    decimation_rows,
    filtered_noise,
)
from crane_identification.signals.routes import ButterworthDifferentiator
from crane_model import DataError

STEP = 0.005
TIME = STEP * np.arange(4001)


def test_butterworth_gain_and_derivatives_of_a_sinusoid() -> None:
    """Filtered twice, a sinusoid is halved at the cut-off and unchanged well below it."""
    estimator = ButterworthDifferentiator(cutoff=10.0)
    away = slice(500, -500)
    at_cutoff = np.sin(2 * np.pi * 10.0 * TIME)
    motion = estimator.estimate(at_cutoff[:, None], STEP, np.zeros(1))
    assert np.std(motion.position[away]) == pytest.approx(0.5 * np.std(at_cutoff[away]), rel=1e-3)
    omega = 2 * np.pi * 0.5
    motion = estimator.estimate(np.sin(omega * TIME)[:, None], STEP, np.zeros(1))
    np.testing.assert_allclose(
        motion.velocity[away, 0], omega * np.cos(omega * TIME)[away], atol=1e-3
    )
    np.testing.assert_allclose(
        motion.acceleration[away, 0], -(omega**2) * np.sin(omega * TIME)[away], atol=2e-3
    )


def test_butterworth_velocity_noise() -> None:
    resolution = 1e-4
    readings = np.random.default_rng(1).uniform(-0.5, 0.5, size=(50_000, 1)) * resolution
    motion = ButterworthDifferentiator(20.0).estimate(readings, STEP, np.array([resolution]))
    assert motion.velocity[100:-100].std() == pytest.approx(motion.velocity_noise[0], rel=0.03)


def test_butterworth_refuses_what_it_cannot_do() -> None:
    with pytest.raises(DataError, match="100 Hz"):
        ButterworthDifferentiator(100.0).estimate(np.zeros((500, 1)), STEP, np.zeros(1))
    with pytest.raises(DataError, match="at least 14 samples"):
        ButterworthDifferentiator(10.0).estimate(np.zeros((10, 1)), STEP, np.zeros(1))


def test_decimate_is_that_of_scipy_away_from_the_ends() -> None:
    values = np.random.default_rng(2).normal(size=(4001, 3))
    expected = signal.decimate(values, 10, axis=0, zero_phase=True)
    np.testing.assert_allclose(decimate(values, 10)[90:-90], expected[90:-90], atol=1e-7)


@given(samples=st.integers(1, 1000), factor=st.integers(1, 50))
def test_rows_are_matlabs(samples: int, factor: int) -> None:
    """nout = ceil(n/r); nbeg = r - (r nout - n); rows nbeg:r:n, counted from 1."""
    kept = -(-samples // factor)
    first = factor - (factor * kept - samples)
    np.testing.assert_array_equal(
        decimation_rows(samples, factor), np.arange(first, samples + 1, factor) - 1
    )


def test_parameters_survive_the_same_filter_on_both_sides() -> None:
    """Exactly, whatever the columns, and at the ends too: the filter is linear."""
    rng = np.random.default_rng(3)
    columns, parameters = rng.normal(size=(999, 4)), np.array([3.0, -1.0, 0.2, 50.0])
    filtered, force = decimate(columns, 7), decimate(columns @ parameters, 7)
    np.testing.assert_allclose(filtered @ parameters, force, rtol=1e-9, atol=1e-9)


def test_periodic_values_have_no_ends() -> None:
    values = np.random.default_rng(4).normal(size=600)
    whole = decimate(values, 5, periodic=True)
    shifted = decimate(np.roll(values, 100), 5, periodic=True)
    np.testing.assert_allclose(np.roll(whole, 20), shifted, atol=1e-12)


def test_decimation_removes_what_lies_above_the_band() -> None:
    low, high = np.sin(2 * np.pi * 1.0 * TIME), np.sin(2 * np.pi * 25.0 * TIME)
    out = decimate(low + high, 10)
    np.testing.assert_allclose(out[20:-20], low[decimation_rows(4001, 10)][20:-20], atol=0.02)


@pytest.mark.parametrize("factor", [1, 2, 30])
def test_filtered_noise_has_the_correlation_that_it_says(factor: int) -> None:
    noise = np.random.default_rng(6).normal(size=(500 * factor, 200))
    rows = decimate(noise, factor, periodic=True)
    around = np.concatenate([rows, rows])
    found = [(around[lag : lag + 500] * rows).mean() / (rows**2).mean() for lag in range(10)]
    said = np.zeros(10)
    said[: len(filtered_noise(factor))] = filtered_noise(factor)[:10]
    np.testing.assert_allclose(found, said, atol=0.015)


def test_too_few_samples() -> None:
    with pytest.raises(DataError, match="24 samples cannot be filtered; at least 25"):
        decimate(np.zeros(24), 2)


@given(bandwidth=st.floats(0.1, 1e3), rate=st.floats(20.0, 2e3))
def test_factor_keeps_a_fixed_share_of_the_bandwidth(bandwidth: float, rate: float) -> None:
    factor = decimation_factor(bandwidth, 1 / rate)
    assert factor >= 1
    kept = [0.8 * 0.5 * rate / f for f in (factor, factor + 1)]  # Hz passed by f and by f + 1
    share = decimation_factor.__globals__["KEPT_SHARE"]
    assert factor == 1 or kept[0] >= share * bandwidth * (1 - 1e-6)
    assert kept[1] < share * bandwidth * (1 + 1e-6)
