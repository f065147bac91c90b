from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.signal import lfilter
from statsmodels.regression.linear_model import OLS, WLS

from crane_identification import Covariance
from crane_identification.estimation.least_squares import least_squares
from crane_identification.estimation.regression import Rows, balancing
from crane_model import DataError

THETA = np.array([3.0, 10.0, 1.0, 2.0, 0.5])
NAMES = ("inertia", "gravity", "viscous", "coulomb", "offset")


def columns(n: int) -> np.ndarray:
    """(n, 5) regressor of one pendulum with friction on a periodic motion."""
    time = np.arange(n) / 5.0
    omega = 2 * np.pi / 20 * np.arange(1, 6)
    q = np.sin(np.outer(time, omega) + np.arange(5)) @ (1 / np.arange(1, 6))
    v = np.gradient(q, time)
    return np.column_stack([np.gradient(v, time), np.cos(q), v, np.sign(v), np.ones(n)])


def rows(matrix: np.ndarray, force: np.ndarray, used: np.ndarray | None = None) -> Rows:
    """Rows of (n, j, p) and (n, j); (n, p) and (n,) for one joint."""
    if force.ndim == 1:
        matrix, force = matrix[:, None, :], force[:, None]
    n, joints = force.shape
    return Rows(
        joints=tuple(f"joint_{j}" for j in range(joints)),
        names=NAMES[: matrix.shape[2]],
        units=("kg",) * matrix.shape[2],
        time=np.arange(n) / 5.0,
        run=np.zeros(n, dtype=int),
        matrix=matrix,
        force=force,
        used=np.ones((n, joints), dtype=bool) if used is None else used,
    )


def noisy(n: int, correlation: float, rng: np.random.Generator) -> Rows:
    matrix = columns(n)
    noise = lfilter([1.0], [1.0, -correlation], rng.normal(size=n + 200))[200:]
    return rows(matrix, matrix @ THETA + noise)


def test_one_joint_is_ordinary_least_squares() -> None:
    """(31), against numpy and statsmodels."""
    system = noisy(300, 0.0, np.random.default_rng(1))
    matrix, force = system.matrix[:, 0], system.force[:, 0]
    estimate = least_squares(system, Covariance.CLASSICAL)
    expected = OLS(force, matrix).fit()
    np.testing.assert_allclose(estimate.values, np.linalg.lstsq(matrix, force)[0], rtol=1e-10)
    np.testing.assert_allclose(estimate.covariance, expected.cov_params(), rtol=1e-9)
    np.testing.assert_allclose(estimate.std_devs, expected.bse, rtol=1e-9)
    assert estimate.condition_number == pytest.approx(np.linalg.cond(matrix))
    assert estimate.relative_error[0] == pytest.approx(
        np.linalg.norm(expected.resid) / np.linalg.norm(force)
    )
    assert estimate.residual_rms[0] == pytest.approx(np.sqrt(np.mean(expected.resid**2)))
    assert (estimate.samples, estimate.undetermined) == (300, ())


def test_sample_deviation_as_in_robotics() -> None:
    system = noisy(100, 0.0, np.random.default_rng(2))
    estimate = least_squares(system, Covariance.SAMPLE)
    matrix = system.matrix[:, 0]
    deviation = np.std(system.residual(estimate.values), ddof=1)
    expected = deviation * np.sqrt(np.diag(np.linalg.inv(matrix.T @ matrix)))
    np.testing.assert_allclose(estimate.std_devs, expected, rtol=1e-9)


def two_joints(seed: int, n: int = 300, ratio: float = 20.0) -> Rows:
    """The second joint is `ratio` times as noisy as the first and shares its parameters."""
    rng = np.random.default_rng(seed)
    matrix = np.stack([columns(n), columns(n)[::-1]], axis=1)
    noise = rng.normal(size=(n, 2)) * np.array([1.0, ratio])
    return rows(matrix, matrix @ THETA + noise)


def test_joints_are_weighted_by_their_residual() -> None:
    """Against statsmodels' weighted least squares with the true noise, and unweighted."""
    system = two_joints(seed=3)
    stacked, force = system.stacked, system.force[system.used]
    truth = WLS(force, stacked, weights=np.tile([1.0, 1 / 400], 300)).fit()
    estimate = least_squares(system, Covariance.CLASSICAL)
    assert (np.abs(estimate.values - truth.params) < 0.2 * truth.bse).all()
    np.testing.assert_allclose(estimate.std_devs, truth.bse, rtol=0.1)
    ordinary = least_squares(system, Covariance.CLASSICAL, weights=np.ones(2))
    np.testing.assert_allclose(ordinary.values, OLS(force, stacked).fit().params, rtol=1e-9)
    assert (ordinary.std_devs > 5 * estimate.std_devs).all()


def hardly_determined(seed: int) -> Rows:
    """Joint a has 16 rows and 12 parameters of its own, b has 60 rows; both have two in common.

    The noise of both is the same.
    """
    rng = np.random.default_rng(seed)
    matrix = np.zeros((60, 2, 14))
    matrix[:, 0] = rng.standard_normal((60, 14))
    matrix[:, 1, 12:] = rng.standard_normal((60, 2))
    used = np.ones((60, 2), dtype=bool)
    used[16:, 0] = False
    names, none = tuple(f"p{k}" for k in range(14)), ("",) * 14
    time = np.arange(60.0)
    force = rng.standard_normal((60, 2))
    return Rows(("a", "b"), names, none, time, np.zeros(60, dtype=int), matrix, force, used)


def test_a_joint_gains_no_weight_by_having_few_rows() -> None:
    weights = np.array([balancing(hardly_determined(seed)) for seed in range(40)])
    ratio = weights[:, 0] / weights[:, 1]
    assert 0.8 < np.median(ratio) < 1.5  # 2.9 by root mean square residuals
    assert (ratio < 2.0).mean() > 0.8


def test_weights_of_single_rows() -> None:
    system = noisy(200, 0.0, np.random.default_rng(4))
    weights = np.linspace(0.1, 2.0, 200)[:, None]
    expected = WLS(system.force[:, 0], system.matrix[:, 0], weights=weights[:, 0] ** 2).fit()
    estimate = least_squares(system, Covariance.CLASSICAL, weights)
    np.testing.assert_allclose(estimate.values, expected.params, rtol=1e-9)
    np.testing.assert_allclose(estimate.std_devs, expected.bse, rtol=1e-9)


def test_unused_rows_do_not_count() -> None:
    system = noisy(300, 0.3, np.random.default_rng(5))
    used = np.ones((300, 1), dtype=bool)
    used[50:80] = False
    spoilt = system.force.copy()
    spoilt[50:80] = 1e9
    left_out = least_squares(replace(system, force=spoilt, used=used))
    kept = np.flatnonzero(used[:, 0])
    expected = np.linalg.lstsq(system.matrix[kept, 0], system.force[kept, 0])[0]
    np.testing.assert_allclose(left_out.values, expected, rtol=1e-9)
    assert left_out.samples == 270


@settings(max_examples=25)
@given(exponents=st.lists(st.integers(-4, 4), min_size=5, max_size=5))
def test_units_do_not_matter(exponents: list[int]) -> None:
    """Columns in other units give the same parameters in other units."""
    units = 10.0 ** np.array(exponents)
    system = noisy(120, 0.5, np.random.default_rng(6))
    scaled = replace(system, matrix=system.matrix * units)
    before, after = least_squares(system), least_squares(scaled)
    np.testing.assert_allclose(after.values * units, before.values, rtol=1e-6)
    np.testing.assert_allclose(after.std_devs * units, before.std_devs, rtol=1e-6)
    assert after.condition_number_normalized == pytest.approx(before.condition_number_normalized)


def test_undetermined_parameters_are_named_not_invented() -> None:
    """A joint that only moves forwards: Coulomb friction and offset are one number."""
    matrix = columns(200)
    matrix[:, 3] = 1.0
    force = matrix @ THETA + np.random.default_rng(7).normal(size=200)
    estimate = least_squares(rows(matrix, force))
    assert estimate.undetermined == ("coulomb", "offset")
    assert np.isnan(estimate.values[3:]).all()
    assert np.isnan(estimate.std_devs[3:]).all()
    assert estimate.condition_number > 1e12
    reduced = least_squares(rows(matrix[:, :4], force))
    np.testing.assert_allclose(estimate.values[:3], reduced.values[:3], rtol=1e-8)
    np.testing.assert_allclose(estimate.std_devs[:3], reduced.std_devs[:3], rtol=1e-6)
    np.testing.assert_allclose(estimate.residual_rms, reduced.residual_rms, rtol=1e-9)


def test_a_column_of_zeros_is_undetermined() -> None:
    matrix = columns(100)
    matrix[:, 1] = 0.0
    estimate = least_squares(rows(matrix, matrix @ THETA))
    assert estimate.undetermined == ("gravity",)
    np.testing.assert_allclose(estimate.values[[0, 2, 3, 4]], THETA[[0, 2, 3, 4]], rtol=1e-9)
    assert np.isinf(estimate.condition_number)


@pytest.mark.parametrize(("correlation", "samples"), [(0.0, 400), (0.5, 400), (0.9, 400)])
def test_standard_deviations_cover_the_truth(correlation: float, samples: int) -> None:
    """Monte Carlo: two standard deviations hold the truth in about 95 % of all cases, where
    those that take the residual for white hold it far less often."""
    rng = np.random.default_rng(8)
    runs = [noisy(samples, correlation, rng) for _ in range(100)]
    covered = {}
    for assumption in (Covariance.CORRELATED, Covariance.CLASSICAL):
        estimates = [least_squares(run, assumption) for run in runs]
        within = [np.abs(e.values - THETA) < 2 * e.std_devs for e in estimates]
        covered[assumption] = np.mean(within)
    assert 0.91 < covered[Covariance.CORRELATED] < 0.995
    if correlation > 0:
        assert covered[Covariance.CLASSICAL] < 0.88


def test_correlation_of_several_runs_with_gaps() -> None:
    """The same, stacked from short runs with masked rows."""
    rng = np.random.default_rng(9)
    within = []
    for _ in range(100):
        parts = [noisy(100, 0.7, rng) for _ in range(4)]
        used = np.abs(columns(100)[:, 2:3]) > 0.1
        stack = Rows.stack([replace(part, used=used) for part in parts])
        estimate = least_squares(stack)
        within.append(np.abs(estimate.values - THETA) < 2 * estimate.std_devs)
    assert 0.90 < np.mean(within) < 0.995


def few(n: int, correlation: float, rng: np.random.Generator) -> Rows:
    """Two periods of a sine, a cosine and a constant."""
    angle = np.linspace(0.0, 4.0 * np.pi, n)
    matrix = np.column_stack([np.sin(angle), np.cos(angle), np.ones(n)])
    noise = lfilter([1.0], [1.0, -correlation], rng.normal(size=n + 200))[200:]
    return rows(matrix, matrix @ THETA[:3] + noise)


@pytest.mark.parametrize(
    ("samples", "correlation", "least"), [(8, 0.0, 0.94), (16, 0.6, 0.88), (24, 0.8, 0.88)]
)
def test_intervals_of_few_rows(samples: int, correlation: float, least: float) -> None:
    """By Student's t, and without taking noise for white that few rows do not show to be white."""
    rng = np.random.default_rng(12)
    estimates = [least_squares(few(samples, correlation, rng)) for _ in range(150)]
    within = np.array([np.abs(e.values - THETA[:3]) < 2 * e.std_devs for e in estimates])
    told = np.array([np.isfinite(e.std_devs) for e in estimates])
    assert least < within[told].mean() < 0.995


def test_too_few_rows_and_wrong_numbers() -> None:
    system = noisy(100, 0.0, np.random.default_rng(10))
    few = replace(system, used=np.arange(100)[:, None] < 5)
    with pytest.raises(DataError, match="5 rows for 5 parameters"):
        least_squares(few)
    system.matrix[40, 0, 2] = np.nan
    with pytest.raises(DataError, match=r"joint joint_0 at 8 s"):
        least_squares(system)


def test_rows_of_different_models_do_not_stack() -> None:
    system = noisy(50, 0.0, np.random.default_rng(11))
    with pytest.raises(DataError, match="cannot be stacked"):
        Rows.stack([system, replace(system, joints=("other",))])
    with pytest.raises(DataError, match="need"):
        replace(system, used=np.ones((49, 1), dtype=bool))
