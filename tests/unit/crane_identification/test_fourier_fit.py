import numpy as np
import pytest

from crane_identification.options import Options
from crane_identification.signals.butterworth import ButterworthDifferentiator
from crane_identification.signals.fourier import FourierFit
from crane_identification.signals.kalman import KalmanSmoother
from crane_identification.signals.routes import estimate_period, estimate_record
from crane_model.errors import DataError

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
    position, velocity, _ = series(400, 2.5)
    noise = 1e-4
    measured = position + noise * np.random.default_rng(2).normal(size=position.shape)
    motion = FourierFit().estimate(measured, STEP, np.zeros(1))
    assert motion.position_noise[0] == pytest.approx(noise, rel=0.05)
    error = np.sqrt(np.mean((motion.velocity - velocity) ** 2))
    assert motion.velocity_noise[0] == pytest.approx(error, rel=0.6)


@pytest.mark.parametrize("decay", [2.5, 3.5])
def test_tuned_by_the_data_it_beats_butterworth_tuned_by_the_truth(decay: float) -> None:
    position, _, acceleration = series(800, decay)
    measured = position + 1e-5 * np.random.default_rng(3).normal(size=position.shape)

    def error(estimator: FourierFit | ButterworthDifferentiator) -> float:
        motion = estimate_period(estimator, measured, STEP, np.zeros(1))
        return float(np.sqrt(np.mean((motion.acceleration - acceleration) ** 2)))

    best = min(error(ButterworthDifferentiator(fc)) for fc in np.geomspace(1.0, 40.0, 20))
    assert error(FourierFit()) < 1.03 * best


def test_a_joint_that_stands_has_no_velocity() -> None:
    motion = FourierFit().estimate(np.full((N, 1), 0.3), STEP, np.array([1e-4]))
    np.testing.assert_allclose(motion.position, 0.3)
    np.testing.assert_allclose(motion.velocity, 0.0, atol=1e-12)


def test_harmonics_may_be_given() -> None:
    position, *_ = series(5, 1.5)
    motion = FourierFit((40.0,)).estimate(position, STEP, np.zeros(1))
    assert motion.bandwidth[0] == pytest.approx(40.0 / (N * STEP))
    with pytest.raises(DataError, match="a positive number for each of 1 coordinates"):
        FourierFit((1.0, 2.0)).estimate(position, STEP, np.zeros(1))


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
