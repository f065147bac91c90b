import numpy as np
import pytest
from filterpy.common import Q_continuous_white_noise
from filterpy.kalman import KalmanFilter

from crane_identification.signals.kalman import (
    KalmanSmoother,
    predicted_covariance,
    scaled_filter,
    smooth,
    smoothed_covariance,
)
from crane_identification.signals.motion import encoder_resolution
from crane_identification.signals.routes import estimate_period
from crane_model import DataError

STEP = 0.005
RESOLUTION = 1e-4


def sinusoid(n: int = 4000, frequency: float = 0.25, amplitude: float = 0.5) -> np.ndarray:
    """Position, velocity and acceleration, (3, n)."""
    omega = 2 * np.pi * frequency
    angle = omega * STEP * np.arange(n)
    return amplitude * np.stack([np.sin(angle), omega * np.cos(angle), -(omega**2) * np.sin(angle)])


def rounded(position: np.ndarray) -> np.ndarray:
    return RESOLUTION * np.round(position / RESOLUTION)


@pytest.mark.parametrize("h", [0.02, 0.3])
def test_equals_filterpy_sample_by_sample(h: float) -> None:
    """The compiled recursion with converged gains against filterpy's own loops."""
    readings = np.cumsum(np.random.default_rng(1).normal(size=1500))
    kalman = scaled_filter(h)
    kalman.x = np.array([readings[0], 0.0, 0.0])
    means, covariances, *_ = kalman.batch_filter(readings, update_first=True)
    expected = kalman.rts_smoother(means, covariances)[0]
    smoothed = smooth(readings, h)
    np.testing.assert_allclose(smoothed[5:], expected[5:], rtol=1e-8, atol=1e-8)
    # At the very start the unknown initial velocity costs both of them digits.
    np.testing.assert_allclose(smoothed[:5], expected[:5], atol=1e-5)


def test_steady_state_covariances_are_those_of_filterpy() -> None:
    kalman = scaled_filter(0.1)
    _, filtered, _, predicted = kalman.batch_filter(np.zeros(1500), update_first=True)
    smoothed = kalman.rts_smoother(np.zeros((1500, 3)), filtered)[1]
    np.testing.assert_allclose(predicted_covariance(0.1), predicted[-1], rtol=1e-7, atol=1e-12)
    np.testing.assert_allclose(smoothed_covariance(0.1), smoothed[750], rtol=1e-7, atol=1e-12)


def test_scaling_is_the_same_filter_in_si_units() -> None:
    """Against a filter written in rad and s, with noise and jerk as given."""
    noise, jerk = 3e-5, 0.02
    rng = np.random.default_rng(2)
    position = sinusoid(1200)[0] + noise * rng.normal(size=1200)
    kalman = KalmanFilter(dim_x=3, dim_z=1)
    kalman.F = np.array([[1, STEP, STEP**2 / 2], [0, 1, STEP], [0, 0, 1]])
    kalman.H = np.array([[1.0, 0.0, 0.0]])
    kalman.R *= noise**2
    kalman.Q = Q_continuous_white_noise(3, STEP, jerk)
    kalman.P = np.diag([noise**2, 10.0, 1e3])
    kalman.x = np.array([position[0], 0.0, 0.0])
    means, covariances, *_ = kalman.batch_filter(position, update_first=True)
    expected = kalman.rts_smoother(means, covariances)[0][200:-200]
    smoother = KalmanSmoother(jerk_density=(jerk,), position_noise=(noise,))
    motion = smoother.estimate(position[:, None], STEP, np.zeros(1))
    np.testing.assert_allclose(motion.position[200:-200, 0], expected[:, 0], atol=1e-10)
    np.testing.assert_allclose(motion.velocity[200:-200, 0], expected[:, 1], atol=1e-8)
    np.testing.assert_allclose(motion.acceleration[200:-200, 0], expected[:, 2], atol=1e-6)


def test_follows_a_sinusoid_read_by_a_coarse_encoder() -> None:
    truth = sinusoid()
    motion = KalmanSmoother().estimate(rounded(truth[0])[:, None], STEP, np.array([RESOLUTION]))
    away = slice(400, -400)
    for estimated, true, tolerance in (
        (motion.position, truth[0], 2e-4),
        (motion.velocity, truth[1], 1e-3),
        (motion.acceleration, truth[2], 0.02),
    ):
        error = (estimated[:, 0] - true)[away]
        assert np.sqrt(np.mean(error**2)) < tolerance * np.abs(true).max()


def test_bandwidth_is_where_a_sinusoid_is_halved() -> None:
    smoother = KalmanSmoother(jerk_density=(0.05,), position_noise=(1e-4,))
    (bandwidth,) = smoother.estimate(sinusoid()[0][:, None], STEP, np.zeros(1)).bandwidth
    truth = sinusoid(frequency=float(bandwidth))[0]
    smoothed = smoother.estimate(truth[:, None], STEP, np.zeros(1)).position[:, 0]
    gain = np.std(smoothed[1000:-1000]) / np.std(truth[1000:-1000])
    assert gain == pytest.approx(0.5, abs=0.01)


def test_velocity_noise_is_that_of_repeated_noise() -> None:
    """Monte Carlo: the part of the error that noise causes is at most what is announced."""
    noise, jerk = 1e-4, 0.05
    rng = np.random.default_rng(3)
    smoother = KalmanSmoother(jerk_density=(jerk,), position_noise=(noise,))
    motion = smoother.estimate(noise * rng.normal(size=(20_000, 1)), STEP, np.zeros(1))
    spread = motion.velocity[500:-500].std()
    assert 0.4 * motion.velocity_noise[0] < spread < motion.velocity_noise[0]


def test_likelihood_finds_jerk_and_noise_of_a_simulated_random_motion() -> None:
    """The state equation itself, simulated: both parameters come back."""
    noise, jerk = 2e-4, 0.5
    rng = np.random.default_rng(4)
    transition = np.array([[1, STEP, STEP**2 / 2], [0, 1, STEP], [0, 0, 1]])
    disturbances = rng.multivariate_normal(
        np.zeros(3), Q_continuous_white_noise(3, STEP, jerk), size=20_000, method="cholesky"
    )
    states = np.zeros((20_000, 3))
    for k in range(1, 20_000):
        states[k] = transition @ states[k - 1] + disturbances[k]
    readings = states[:, 0] + noise * rng.normal(size=20_000)
    motion = KalmanSmoother().estimate(readings[:, None], STEP, np.zeros(1))
    true_bandwidth = (jerk / (noise**2 * STEP)) ** (1 / 6) / (2 * np.pi)
    assert motion.position_noise[0] == pytest.approx(noise, rel=0.03)
    assert motion.bandwidth[0] == pytest.approx(true_bandwidth, rel=0.05)
    error = (motion.velocity[:, 0] - states[:, 1])[500:-500]
    assert np.std(error) == pytest.approx(motion.velocity_noise[0], rel=0.05)


def test_noise_is_never_below_the_rounding_of_the_encoder() -> None:
    still = np.full((500, 1), 0.3)
    motion = KalmanSmoother().estimate(still, STEP, np.array([RESOLUTION]))
    assert motion.position_noise[0] >= RESOLUTION / np.sqrt(12)
    np.testing.assert_allclose(motion.velocity, 0.0, atol=1e-12)


def test_a_period_has_no_ends() -> None:
    """One averaged period, started anywhere, gives the same motion."""
    position = rounded(sinusoid(800)[0])[:, None]  # 4 s, one period
    resolution = np.array([RESOLUTION])
    motion = estimate_period(KalmanSmoother(), position, STEP, resolution)
    shifted = estimate_period(KalmanSmoother(), np.roll(position, 300, axis=0), STEP, resolution)
    np.testing.assert_allclose(
        np.roll(motion.acceleration, 300, axis=0), shifted.acceleration, atol=5e-3
    )
    assert np.abs(motion.acceleration[:, 0] - sinusoid(800)[2]).max() < 0.05


def test_progress_and_errors() -> None:
    told: list[tuple[str, float]] = []
    position = np.stack([sinusoid(200)[0]] * 3, axis=1)
    KalmanSmoother().estimate(position, STEP, np.zeros(3), lambda *done: told.append(done))
    assert [share for _, share in told] == pytest.approx([1 / 3, 2 / 3, 1.0])
    with pytest.raises(DataError, match="at least 20 samples"):
        KalmanSmoother().estimate(position[:10], STEP, np.zeros(3))
    position[7, 1] = np.nan
    with pytest.raises(DataError, match=r"joint 1 at 0\.035 s is nan"):
        KalmanSmoother().estimate(position, STEP, np.zeros(3))


def test_resolution_is_the_smallest_step_between_readings() -> None:
    readings = np.stack([rounded(sinusoid()[0]), np.full(4000, 0.7)], axis=1)
    np.testing.assert_allclose(encoder_resolution(readings), [RESOLUTION, 0.0], rtol=1e-6)
