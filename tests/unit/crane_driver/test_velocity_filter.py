import numpy as np
import pytest
from filterpy.common import Q_continuous_white_noise
from filterpy.kalman import KalmanFilter
from scipy.linalg import solve_discrete_are

from crane_driver import VelocityFilter
from crane_driver.velocity_filter import JERK_MEMORY_S, UNKNOWN_VELOCITY

STEP = 0.005
JERK_DENSITY = np.array([1e-4, 2.4e-4, 1e-3, 1e-5])
RESOLUTION = np.array([1e-3, 4e-4, 4e-4, 1e-4])


def run(
    velocity_filter: VelocityFilter, stamps: np.ndarray, positions: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Estimates (n, j) of a filter that is given positions (n, j)."""
    estimates = [velocity_filter.update(*sample) for sample in zip(stamps, positions, strict=True)]
    position, velocity, acceleration = np.moveaxis(np.array(estimates), 1, 0)
    return position, velocity, acceleration


def filterpy_filter(joint: int, first_reading: float) -> KalmanFilter:
    kalman = KalmanFilter(dim_x=3, dim_z=1)
    kalman.H = np.array([[1.0, 0.0, 0.0]])
    kalman.R = np.array([[RESOLUTION[joint] ** 2 / 12]])
    kalman.x = np.array([first_reading, 0.0, 0.0])
    kalman.P = np.diag([kalman.R[0, 0], UNKNOWN_VELOCITY**2, JERK_DENSITY[joint] * JERK_MEMORY_S])
    return kalman


@pytest.mark.parametrize("jitter", [0.0, 0.3])
def test_state_and_covariance_of_filterpy(jitter: float) -> None:
    random = np.random.default_rng(3)
    stamps = np.cumsum(STEP * (1 + random.uniform(-jitter, jitter, 400)))
    positions = np.cumsum(random.normal(0, 1e-3, (400, 4)), axis=0)
    velocity_filter = VelocityFilter(JERK_DENSITY, RESOLUTION)
    estimates = np.stack(run(velocity_filter, stamps, positions), axis=-1)
    for joint in range(4):
        kalman = filterpy_filter(joint, positions[0, joint])
        for k in range(1, 400):
            dt = stamps[k] - stamps[k - 1]
            kalman.F = np.array([[1, dt, dt**2 / 2], [0, 1, dt], [0, 0, 1]])
            kalman.Q = Q_continuous_white_noise(3, dt, JERK_DENSITY[joint])
            kalman.predict()
            kalman.update(positions[k, joint])
            np.testing.assert_allclose(estimates[k, joint], kalman.x, rtol=1e-6, atol=1e-9)
        np.testing.assert_allclose(velocity_filter.covariance[joint], kalman.P, rtol=1e-6)


def test_constant_velocity_is_unbiased() -> None:
    speed = np.array([0.4, -0.16, 0.02, 0.0])
    stamps = np.arange(0, 20, STEP)
    positions = np.round(stamps[:, None] * speed / RESOLUTION) * RESOLUTION
    _, velocity, acceleration = run(VelocityFilter(JERK_DENSITY, RESOLUTION), stamps, positions)
    settled = stamps > 2
    np.testing.assert_allclose(velocity[settled].mean(axis=0), speed, atol=2e-4)
    np.testing.assert_allclose(acceleration[settled].mean(axis=0), 0.0, atol=1e-3)


def response(joint: int, frequency: float) -> complex:
    """Estimated over true velocity of a sinusoid, by the gain of the Riccati equation."""
    F = np.array([[1, STEP, STEP**2 / 2], [0, 1, STEP], [0, 0, 1]])
    H = np.array([[1.0, 0.0, 0.0]])
    Q = Q_continuous_white_noise(3, STEP, JERK_DENSITY[joint])
    R = np.array([[RESOLUTION[joint] ** 2 / 12]])
    predicted = solve_discrete_are(F.T, H.T, Q, R)
    gain = predicted @ H.T / (predicted[0, 0] + R)
    z = np.exp(2j * np.pi * frequency * STEP)
    state = np.linalg.solve(z * np.eye(3) - F + gain @ H @ F, z * gain[:, 0])
    return complex(state[1] / (2j * np.pi * frequency))


@pytest.mark.parametrize("frequency", [0.05, 0.5, 2.0])
def test_sinusoid_is_tracked_with_the_lag_that_the_gain_predicts(frequency: float) -> None:
    omega = 2 * np.pi * frequency
    stamps = np.arange(0, 60, STEP)
    positions = np.repeat(np.sin(omega * stamps)[:, None], 4, axis=1)
    _, velocity, _ = run(VelocityFilter(JERK_DENSITY, RESOLUTION), stamps, positions)
    settled = stamps > 20
    for joint in range(4):
        expected = response(joint, frequency)
        truth = omega * np.real(expected * np.exp(1j * omega * stamps))
        error = np.abs(velocity[:, joint] - truth)[settled].max()
        assert error < 1e-4 * omega


@pytest.mark.parametrize("jitter", [0.0, 0.2])
def test_motion_of_the_crane_through_its_encoder(jitter: float) -> None:
    """0.1 Hz, 0.2 rad, as fast as the inner boom may go: within 1 % rms, 1 ms late at most."""
    random = np.random.default_rng(5)
    omega, amplitude, resolution = 2 * np.pi * 0.1, 0.2, 4e-4
    stamps = np.arange(0, 60, STEP) + STEP * random.uniform(-jitter, jitter, 12_000)
    positions = np.round(amplitude * np.sin(omega * stamps) / resolution) * resolution
    velocity_filter = VelocityFilter([2.4e-4], [resolution])
    _, velocity, acceleration = run(velocity_filter, stamps, positions[:, None])
    settled = stamps > 5
    angle = omega * stamps[settled]
    fit = np.column_stack([np.cos(angle), np.sin(angle)])
    (cosine, sine), *_ = np.linalg.lstsq(fit, velocity[settled, 0])
    error = velocity[settled, 0] - amplitude * omega * np.cos(angle)
    assert abs(np.arctan2(sine, cosine) / omega) < 0.001
    assert np.abs(error).max() < 0.02 * amplitude * omega
    assert np.sqrt(np.mean(error**2)) < 0.01 * amplitude * omega
    error = acceleration[settled, 0] + amplitude * omega**2 * np.sin(angle)
    assert np.sqrt(np.mean(error**2)) < 0.1 * amplitude * omega**2


def two_joints() -> VelocityFilter:
    velocity_filter = VelocityFilter([1e-3, 1e-3], [1e-4, 1e-4])
    run(velocity_filter, np.arange(200) * STEP, np.outer(np.arange(200) * STEP, [1.0, -1.0]))
    return velocity_filter


def test_first_reading_knows_no_velocity() -> None:
    position, velocity, acceleration = VelocityFilter([1e-3], [1e-4]).update(12.0, [0.7])
    assert position.tolist() == [0.7]
    assert np.isnan(velocity).all()
    assert np.isnan(acceleration).all()


@pytest.mark.parametrize("stamp", [0.995 + 0.11, 0.995 - 0.11])
def test_gap_or_clock_that_steps_back_resets(stamp: float) -> None:
    velocity_filter, fresh = two_joints(), VelocityFilter([1e-3, 1e-3], [1e-4, 1e-4])
    for k in range(50):
        reading = [5.0 + 0.01 * k, 7.0]
        after_gap = velocity_filter.update(stamp + k * STEP, reading)
        np.testing.assert_array_equal(after_gap, fresh.update(stamp + k * STEP, reading))


def test_missed_samples_shorter_than_the_gap_do_not_reset() -> None:
    _, velocity, _ = two_joints().update(0.995 + 0.09, [0.995 + 0.09, -0.995 - 0.09])
    np.testing.assert_allclose(velocity, [1.0, -1.0], atol=1e-3)


@pytest.mark.parametrize("stamp", [0.995, 0.990])
def test_reading_that_is_not_newer_changes_nothing(stamp: float) -> None:
    velocity_filter, undisturbed = two_joints(), two_joints()
    velocity_filter.update(stamp, [3.0, 3.0])
    sample = (1.0, [1.0, -1.0])
    np.testing.assert_array_equal(velocity_filter.update(*sample), undisturbed.update(*sample))


def test_reading_that_is_missing_is_never_made_up() -> None:
    velocity_filter = two_joints()
    estimates = np.array(velocity_filter.update(1.0, [1.0, np.nan]))
    assert np.isfinite(estimates[:, 0]).all()
    assert np.isnan(estimates[:, 1]).all()
    _, velocity, _ = velocity_filter.update(1.005, [1.005, -1.005])
    np.testing.assert_allclose(velocity, [1.0, -1.0], atol=1e-3)


def test_estimates_are_not_changed_by_the_next_update() -> None:
    velocity_filter = two_joints()
    position, _, _ = velocity_filter.update(1.0, [1.0, -1.0])
    kept = position.copy()
    velocity_filter.update(1.005, [1.5, -1.5])
    np.testing.assert_array_equal(position, kept)


def test_wrong_number_of_joints() -> None:
    with pytest.raises(ValueError, match=r"2 joints, got positions of \(3,\)"):
        two_joints().update(2.0, [0.0, 0.0, 0.0])
    with pytest.raises(ValueError, match="one value a joint"):
        VelocityFilter([1e-3], [1e-4, 1e-4])
    with pytest.raises(ValueError, match="must be positive"):
        VelocityFilter([1e-3], [0.0])
