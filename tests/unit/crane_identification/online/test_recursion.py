"""The recursion against the batch solution, filterpy, and weighted least squares by numpy."""

import numpy as np
import pytest
from filterpy.kalman import KalmanFilter

from crane_identification.estimation.least_squares import least_squares
from crane_identification.estimation.regression import Rows
from crane_identification.online.recursion import Recursion

JOINTS, PARAMETERS = 3, 20
NOISE = np.array([30.0, 5.0, 100.0])


def system(
    n: int, seed: int = 0, parameters: int = PARAMETERS
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Columns (n, 3, p) of very different sizes, forces (n, 3), and the true parameters."""
    rng = np.random.default_rng(seed)
    theta = rng.normal(size=parameters) * 10.0 ** rng.uniform(0, 3, parameters)
    matrix = rng.normal(size=(n, JOINTS, parameters)) * 10.0 ** rng.uniform(-2, 1, parameters)
    matrix[:, 2, : parameters // 2] = 0.0  # as the telescope's row
    return matrix, matrix @ theta + NOISE * rng.normal(size=(n, JOINTS)), theta


def fed(
    matrix: np.ndarray,
    force: np.ndarray,
    used: np.ndarray | None = None,
    forgetting: float = 1.0,
) -> Recursion:
    recursion = Recursion(matrix.shape[1], matrix.shape[2], forgetting)
    used = np.ones(force.shape, dtype=bool) if used is None else used
    for row in zip(matrix, force, used, strict=True):
        recursion.update(*row)
    return recursion


def as_rows(matrix: np.ndarray, force: np.ndarray, used: np.ndarray) -> Rows:
    n, joints, parameters = matrix.shape
    names = tuple(f"p{i}" for i in range(parameters))
    joint_names = tuple(f"j{i}" for i in range(joints))
    time, run = np.arange(n) * 0.05, np.zeros(n, dtype=int)
    return Rows(joint_names, names, ("-",) * parameters, time, run, matrix, force, used)


def test_without_forgetting_it_is_the_batch_solution() -> None:
    matrix, force, _ = system(2000)
    used = np.random.default_rng(1).random(force.shape) > 0.3
    batch = least_squares(as_rows(matrix, force, used))
    solution = fed(matrix, force, used).solve()
    np.testing.assert_allclose(solution.values, batch.values, rtol=1e-8)
    np.testing.assert_allclose(solution.residual_rms, batch.residual_rms, rtol=1e-8)
    # the batch fits an autoregression to a residual that is white but for its sample
    np.testing.assert_allclose(solution.std_devs, batch.std_devs, rtol=0.05)


def test_one_joint_has_the_classical_covariance() -> None:
    matrix, force, _ = system(500)
    matrix, force = matrix[:, :1], force[:, :1]
    solution = fed(matrix, force).solve()
    residual = force[:, 0] - matrix[:, 0] @ np.linalg.lstsq(matrix[:, 0], force[:, 0])[0]
    variance = residual @ residual / (500 - PARAMETERS)
    expected = variance * np.linalg.inv(matrix[:, 0].T @ matrix[:, 0])
    np.testing.assert_allclose(solution.covariance, expected, rtol=1e-6, atol=1e-12)


@pytest.mark.parametrize("forgetting", [1.0, 0.99])
def test_a_kalman_filter_with_a_constant_state_agrees(forgetting: float) -> None:
    matrix, force, _ = system(600)
    weights = 1.0 / NOISE
    # scaled, for the filter propagates a covariance and loses digits otherwise
    white = matrix * weights[:, None]
    norms = np.linalg.norm(white, axis=(0, 1)) / np.sqrt(len(matrix))
    kalman = KalmanFilter(dim_x=PARAMETERS, dim_z=JOINTS)
    kalman.P = np.eye(PARAMETERS) * 1e8
    kalman.Q = np.zeros((PARAMETERS, PARAMETERS))
    kalman.R = np.eye(JOINTS)
    kalman.alpha = forgetting**-0.5
    recursion = Recursion(JOINTS, PARAMETERS, forgetting)
    for scaled, row, tau in zip(white / norms, matrix, force, strict=True):
        kalman.predict()
        kalman.update((tau * weights)[:, None], H=scaled)
        recursion.update(row, tau, np.ones(JOINTS, dtype=bool))
    np.testing.assert_allclose(recursion.values(weights), kalman.x[:, 0] / norms, rtol=1e-5)


def test_quick_values_are_those_of_the_solution() -> None:
    recursion = fed(*system(300)[:2])
    solution = recursion.solve()
    np.testing.assert_allclose(recursion.values(solution.weights), solution.values, rtol=1e-9)


def test_it_is_as_exact_after_hours() -> None:
    """5.5 h of rows at 20 Hz lose nothing: equal to least squares on what is remembered."""
    forgetting, parameters = 0.999, 6
    matrix, force, _ = system(400_000, parameters=parameters)
    matrix, force = matrix[:, :1], force[:, :1]
    values = fed(matrix, force, forgetting=forgetting).solve().values
    last = 40_000  # what is older has a weight below 1e-17
    root = forgetting ** (0.5 * np.arange(last)[::-1])
    expected = np.linalg.lstsq(matrix[-last:, 0] * root[:, None], force[-last:, 0] * root)[0]
    np.testing.assert_allclose(values, expected, rtol=1e-10)


def test_forgetting_follows_a_step_change() -> None:
    matrix, force, theta = system(4000)
    strongest = np.argmax(np.abs(theta) * np.linalg.norm(matrix, axis=(0, 1)))
    changed = theta.copy()
    changed[strongest] *= 2.0
    force[2000:] += matrix[2000:] @ (changed - theta)
    follows, remembers = fed(matrix, force, forgetting=0.99).solve(), fed(matrix, force).solve()
    error = np.abs(follows.values - changed)
    assert (error < 5 * follows.std_devs).all()
    assert error[strongest] < 0.05 * abs(theta[strongest])
    assert abs(remembers.values[strongest] - changed[strongest]) > 0.2 * abs(theta[strongest])


def test_standstill_neither_fades_nor_winds_up() -> None:
    matrix, force, _ = system(1000)
    recursion = fed(matrix, force, forgetting=0.99)
    before = recursion.solve()
    still, unused = matrix[0], np.zeros(JOINTS, dtype=bool)
    for _ in range(100_000):
        recursion.update(still, force[0], unused)
    after = recursion.solve()
    np.testing.assert_array_equal(after.std_devs, before.std_devs)
    np.testing.assert_array_equal(after.values, before.values)


def test_a_joint_that_stands_keeps_what_the_others_forget() -> None:
    matrix, force, _ = system(3000)
    used = np.ones(force.shape, dtype=bool)
    used[1000:, 0] = False
    recursion = fed(matrix, force, used, forgetting=0.99)
    assert recursion.rows.tolist() == [1000, 3000, 3000]
    assert np.isfinite(recursion.solve().std_devs).all()


def test_forgetting_has_its_price_in_the_standard_deviations() -> None:
    """Many recordings: the scatter of the estimates is what each of them states."""
    errors, stated = [], []
    for seed in range(60):
        matrix, force, theta = system(600, seed, parameters=4)
        solution = fed(matrix, force, forgetting=0.98).solve()
        errors.append((solution.values - theta) / solution.std_devs)
        stated.append(solution.std_devs)
    assert 0.8 < np.std(errors) < 1.25


def test_parameters_that_only_show_together_are_not_determined() -> None:
    matrix, force, _ = system(200)
    matrix[:, :, 3] = 2.0 * matrix[:, :, 1]
    matrix[:, :, 7] = 0.0
    solution = fed(matrix, force).solve()
    unknown = np.flatnonzero(~solution.determined).tolist()
    assert unknown == [1, 3, 7]
    assert np.isnan(solution.values[unknown]).all()
    assert np.isposinf(solution.std_devs[unknown]).all()
    assert np.isfinite(np.delete(solution.std_devs, unknown)).all()
    assert solution.condition_number == np.inf


def test_nothing_is_known_before_there_are_enough_rows() -> None:
    matrix, force, _ = system(6)
    recursion = fed(matrix, force)
    assert recursion.samples == 18
    assert np.isposinf(recursion.solve().std_devs).all()


def test_correlated_residuals_widen_the_deviations_of_their_joint() -> None:
    recursion = fed(*system(3000)[:2])
    white = recursion.solve()
    correlated = recursion.solve(np.array([9.0, 9.0, 9.0]))
    np.testing.assert_allclose(correlated.values, white.values)
    np.testing.assert_allclose(correlated.std_devs / white.std_devs, 3.0, rtol=0.05)


@pytest.mark.parametrize("forgetting", [0.0, 1.01, -1.0, np.nan])
def test_impossible_forgetting_is_refused(forgetting: float) -> None:
    with pytest.raises(ValueError, match="forgetting must be above 0 and at most 1"):
        Recursion(JOINTS, PARAMETERS, forgetting)
