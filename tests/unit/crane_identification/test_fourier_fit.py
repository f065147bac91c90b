import numpy as np
import pytest

from crane_identification import Options
from crane_identification.signals.decimate import KEPT_SHARE
from crane_identification.signals.kalman import KalmanSmoother
from crane_identification.signals.routes import (
    ButterworthDifferentiator,
    FourierFit,
    estimate_period,
    estimate_record,
)
from crane_model import DataError

N, STEP = 4000, 0.005
TIME = STEP * np.arange(N)
OMEGA = 2 * np.pi / (N * STEP)


def series(harmonics: int, decay: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A period of sines with amplitudes k^-decay: position, velocity, acceleration (n, 1)."""
    k = np.arange(1, harmonics + 1)
    angle = OMEGA * np.outer(TIME, k) + np.random.default_rng(1).uniform(0, 2 * np.pi, harmonics)
    amplitude = 0.3 * k**-decay
    parts = (
        np.sin(angle) @ amplitude,
        np.cos(angle) @ (amplitude * OMEGA * k),
        -np.sin(angle) @ (amplitude * (OMEGA * k) ** 2),
    )
    return tuple(part[:, None] for part in parts)  # type: ignore[return-value]


def test_derivatives_of_a_trigonometric_polynomial_are_exact() -> None:
    position, velocity, acceleration = series(5, 1.5)
    motion = FourierFit().estimate(position, STEP, np.zeros(1))
    np.testing.assert_allclose(motion.position, position, atol=1e-9)
    np.testing.assert_allclose(motion.velocity, velocity, atol=1e-7)
    np.testing.assert_allclose(motion.acceleration, acceleration, atol=1e-6)


def test_noise_is_measured_and_the_error_of_the_velocity_known() -> None:
    position, velocity, _ = series(800, 3.0)
    noise = 1e-5
    measured = position + noise * np.random.default_rng(2).normal(size=position.shape)
    motion = FourierFit().estimate(measured, STEP, np.zeros(1))
    assert motion.position_noise[0] == pytest.approx(noise, rel=0.05)
    error = np.sqrt(np.mean((motion.velocity - velocity) ** 2))
    assert motion.velocity_noise[0] == pytest.approx(error, rel=0.25)


def errors(
    estimator: FourierFit | ButterworthDifferentiator,
    measured: np.ndarray,
    velocity: np.ndarray,
    acceleration: np.ndarray,
) -> np.ndarray:
    """Root mean square errors of velocity and acceleration."""
    motion = estimate_period(estimator, measured, STEP, np.zeros(1))
    missed = (motion.velocity - velocity, motion.acceleration - acceleration)
    return np.sqrt([np.mean(miss**2) for miss in missed])


def best_in_hindsight(
    measured: np.ndarray, velocity: np.ndarray, acceleration: np.ndarray
) -> np.ndarray:
    """Least errors of Butterworth: at the cut-off best for velocity, and for acceleration."""
    every = [
        errors(ButterworthDifferentiator(fc), measured, velocity, acceleration)
        for fc in np.geomspace(1.0, 40.0, 20)
    ]
    return np.min(every, axis=0)


@pytest.mark.parametrize("decay", [2.5, 3.5])
def test_tuned_by_the_data_it_beats_butterworth_tuned_by_the_truth(decay: float) -> None:
    position, *truth = series(800, decay)
    measured = position + 1e-5 * np.random.default_rng(3).normal(size=position.shape)
    assert (
        errors(FourierFit(), measured, *truth) < 1.03 * best_in_hindsight(measured, *truth)
    ).all()


@pytest.mark.parametrize("seed", range(3))
def test_noise_that_is_not_white_does_not_pass_for_motion(seed: int) -> None:
    """Rounding has lines at the rate at which a slow motion crosses the counts of the encoder."""
    position, *truth = series(800, 3.5)
    noise = np.fft.rfft(1e-5 * np.random.default_rng(seed).normal(size=position.shape), axis=0)
    frequency = np.fft.rfftfreq(N, STEP)
    noise[(frequency > 20.0) & (frequency < 30.0)] *= np.sqrt(2.0)
    measured = position + np.fft.irfft(noise, N, axis=0)
    assert (
        errors(FourierFit(), measured, *truth) < 1.05 * best_in_hindsight(measured, *truth)
    ).all()


@pytest.mark.parametrize("order", [5, 6, 8])
def test_the_bandwidth_is_where_motion_and_noise_have_equal_power(order: int) -> None:
    rng = np.random.default_rng(4)
    k, equal = np.arange(1, N // 2), 250.0
    lines = rng.normal(size=(2, len(k), 2)) @ [1.0, 1.0j]  # of motion and of noise
    lines[0] *= (equal / k) ** (order / 2)
    measured = np.fft.irfft(np.concatenate([[0.0], lines.sum(axis=0), [0.0]]), N)[:, None]
    motion = FourierFit().estimate(measured, STEP, np.zeros(1))
    assert motion.bandwidth[0] == pytest.approx(equal / (N * STEP), rel=0.1)


def test_what_the_parallel_filter_keeps_is_not_damped() -> None:
    position, *_ = series(800, 2.5)
    measured = position + 1e-5 * np.random.default_rng(5).normal(size=position.shape)
    motion = FourierFit().estimate(measured, STEP, np.zeros(1))
    kept = np.fft.rfftfreq(N, STEP) <= KEPT_SHARE * motion.bandwidth[0]
    assert kept.sum() > 20
    found, seen = (np.fft.rfft(values, axis=0)[kept] for values in (motion.position, measured))
    np.testing.assert_allclose(found, seen, atol=1e-10)


@pytest.mark.parametrize("samples", [20, N])
@pytest.mark.parametrize(("place", "resolution"), [(0.3, 1e-4), (0.3, 0.0), (0.0, 0.0)])
def test_a_joint_that_stands_has_no_velocity(samples: int, place: float, resolution: float) -> None:
    motion = FourierFit().estimate(np.full((samples, 1), place), STEP, np.array([resolution]))
    np.testing.assert_allclose(motion.position, place)
    np.testing.assert_allclose(motion.velocity, 0.0, atol=1e-12)


def test_each_kind_of_data_has_its_route() -> None:
    """None chooses: the Fourier fit for a period, the Kalman smoother for a record."""
    assert Options().motion is None
    position, *_ = series(5, 1.5)
    chosen = estimate_period(None, position, STEP, np.zeros(1))
    fitted = FourierFit().estimate(position, STEP, np.zeros(1))
    np.testing.assert_array_equal(chosen.velocity, fitted.velocity)
    chosen = estimate_record(None, position, STEP, np.full(1, 1e-5))
    smoothed = KalmanSmoother().estimate(position, STEP, np.full(1, 1e-5))
    np.testing.assert_array_equal(chosen.velocity, smoothed.velocity)
    with pytest.raises(DataError, match="needs averaged, whole periods"):
        estimate_record(FourierFit(), position, STEP, np.zeros(1))
