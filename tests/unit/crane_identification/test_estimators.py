"""The estimators beside plain least squares: each against an oracle of its own."""

import warnings
from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import block_diag, toeplitz
from scipy.signal import lfilter
from statsmodels.regression.linear_model import GLS
from statsmodels.robust.norms import TukeyBiweight
from statsmodels.robust.robust_linear_model import RLM
from unit.crane_identification.test_least_squares import THETA, columns, noisy, rows

from crane_identification import Covariance
from crane_identification.estimation.autoregression import lack_of_fit
from crane_identification.estimation.least_squares import (
    instrumental,
    least_squares,
    robust,
    weighted,
)
from crane_identification.estimation.regression import Rows
from crane_identification.signals.decimate import decimate, filtered_noise
from crane_model import DataError

NOISE = np.array([[1.0, 6.0], [6.0, 49.0]])  # of one period, between two joints
PERIODS = 5


def repeated(seed: int, n: int = 200) -> Rows:
    """Two joints whose forces are means over periods, with noise that both share."""
    rng = np.random.default_rng(seed)
    matrix = np.stack([columns(n), columns(n)[::-1]], axis=1)
    noise = rng.multivariate_normal(np.zeros(2), NOISE, size=(PERIODS, n))
    mean = noise.mean(axis=0)
    return replace(rows(matrix, matrix @ THETA + mean), scatter=(noise - mean,))


def test_weighted_is_generalized_least_squares() -> None:
    """Against statsmodels with the covariance that the scatter shows, and near the true one."""
    system = repeated(1)
    deviation = system.scatter[0].reshape(-1, 2)
    shown = deviation.T @ deviation / 200 / (PERIODS - 1) / PERIODS
    np.testing.assert_allclose(shown, NOISE / PERIODS, rtol=0.2)
    stacked, force = system.matrix.reshape(-1, 5), system.force.ravel()
    expected = GLS(force, stacked, sigma=block_diag(*[shown] * 200)).fit()
    estimate = weighted(system)
    np.testing.assert_allclose(estimate.values, expected.params, rtol=1e-8)
    np.testing.assert_allclose(
        estimate.std_devs, np.sqrt(np.diag(expected.normalized_cov_params)), rtol=0.15
    )
    assert (estimate.std_devs < least_squares(system).std_devs).all()


def test_weights_use_the_joints_that_are_used() -> None:
    """A joint that is masked tells nothing about the noise of the other."""
    system = repeated(2)
    used = np.ones((200, 2), dtype=bool)
    used[50:120, 1] = False
    spoilt = system.force.copy()
    spoilt[50:120, 1] = 1e9
    shown = [weighted(replace(system, used=used, force=f)).values for f in (system.force, spoilt)]
    np.testing.assert_array_equal(*shown)


def test_weights_need_two_periods() -> None:
    with pytest.raises(DataError, match="record at least two"):
        weighted(noisy(100, 0.0, np.random.default_rng(3)))


def test_outliers_do_not_steer_the_robust_fit() -> None:
    system = noisy(400, 0.0, np.random.default_rng(4))
    spoilt = system.force.copy()
    spoilt[::20] += 80.0
    struck = replace(system, force=spoilt)
    estimate, plain = robust(struck), least_squares(struck)
    assert (np.abs(estimate.values - THETA) < 3.5 * estimate.std_devs).all()
    assert np.abs(plain.values - THETA).max() > 5 * np.abs(estimate.values - THETA).max()
    assert "20 rows rejected" in estimate.method
    # statsmodels, from the same start and scale
    theirs = RLM(spoilt[:, 0], system.matrix[:, 0], M=TukeyBiweight()).fit()
    assert (np.abs(estimate.values - theirs.params) < 0.3 * theirs.bse).all()
    np.testing.assert_allclose(estimate.std_devs, theirs.bse, rtol=0.25)


def test_without_outliers_the_robust_fit_costs_little() -> None:
    system = noisy(400, 0.6, np.random.default_rng(5))
    estimate, plain = robust(system), least_squares(system)
    assert (np.abs(estimate.values - plain.values) < plain.std_devs).all()
    np.testing.assert_allclose(estimate.std_devs, plain.std_devs, rtol=0.2)


STEP, DURATION = 0.01, 45.0
INERTIA, VISCOUS = 10.0, 30.0


def controlled(runs: int, seed: int) -> list[tuple[Rows, np.ndarray]]:
    """Rows and instruments of an axis under PD control, pushed by a force that is not measured.

    J q'' + f_v q' = tau + d: the controller answers d, so that q' and q'' know of it.
    """
    rng = np.random.default_rng(seed)
    time = np.arange(0.0, DURATION, STEP)
    n = len(time)
    omega = 2 * np.pi / 20 * np.arange(1, 6)
    angle = np.outer(time, omega) + np.arange(5)
    reference = [
        x @ (1 / omega) for x in (np.sin(angle), omega * np.cos(angle), -(omega**2) * np.sin(angle))
    ]
    push = (
        15.0
        * lfilter([np.sqrt(1 - 0.9**2)], [1.0, -0.9], rng.normal(size=(n + 500, runs)), axis=0)[
            500:
        ]
    )
    q, v = np.full(runs, reference[0][0]), np.full(runs, reference[1][0])
    force, velocity, acceleration = np.empty((3, n, runs))
    for k in range(n):
        force[k] = 400.0 * (reference[0][k] - q) + 150.0 * (reference[1][k] - v)
        velocity[k], acceleration[k] = v, (force[k] + push[k] - VISCOUS * v) / INERTIA
        v = v + STEP * acceleration[k]
        q = q + STEP * v
    along = np.stack([reference[2], reference[1]], axis=1)[:, None, :]
    kept = slice(500, None, 20)
    out = []
    for i in range(runs):
        matrix = np.stack([acceleration[:, i], velocity[:, i]], axis=1)
        out.append((rows(matrix[kept], force[kept, i]), along[kept]))
    return out


def test_instruments_remove_the_bias_that_feedback_brings(measured) -> None:
    """In the mean of 30 recordings least squares is off, and it does not know."""
    runs = 30
    truth, experiments = np.array([INERTIA, VISCOUS]), controlled(runs, seed=6)
    plain = [least_squares(system) for system, _ in experiments]
    freed = [instrumental(system, along) for system, along in experiments]
    errors = [np.array([e.values for e in estimates]) - truth for estimates in (plain, freed)]
    biased, unbiased = (error.mean(axis=0) for error in errors)
    of_mean = [error.std(axis=0, ddof=1) / np.sqrt(runs) for error in errors]
    measured(
        "bias of inertia under feedback, in standard errors, too: least squares; instruments",
        "shown; removed",
        "{biased:.0%}, {biased_sigmas:.0f}; {freed:.1%}, {freed_sigmas:.1f}",
        biased=biased[0] / INERTIA,
        biased_sigmas=abs(biased[0]) / of_mean[0][0],
        freed=unbiased[0] / INERTIA,
        freed_sigmas=abs(unbiased[0]) / of_mean[1][0],
    )
    assert biased[0] < -0.15 * INERTIA
    assert np.abs(biased[0]) > 15 * of_mean[0][0]
    assert (np.abs(unbiased) < 3.5 * of_mean[1]).all()
    assert 0.85 < np.mean([np.abs(e.values - truth) < 1.96 * e.std_devs for e in freed]) <= 1.0


def test_instruments_that_are_the_regressor_give_least_squares() -> None:
    system = repeated(7)
    along = system.matrix
    for covariance in (Covariance.CLASSICAL, Covariance.CORRELATED):
        same, plain = instrumental(system, along, covariance), least_squares(system, covariance)
        np.testing.assert_allclose(same.values, plain.values, rtol=1e-9)
        np.testing.assert_allclose(same.covariance, plain.covariance, rtol=1e-6)


def test_standard_deviations_of_short_averages_are_known_well() -> None:
    """Three periods of 50 rows behind the parallel filter, against the true covariance.

    A free autoregression of such rows finds standard deviations that scatter by a third.
    """
    samples, factor, periods = 50, 20, 3
    rng, matrix = np.random.default_rng(12), columns(samples)
    covariance = toeplitz(np.pad(filtered_noise(factor), (0, samples))[:samples])
    inverse = np.linalg.pinv(matrix)
    size = decimate(rng.normal(size=(factor * samples, 1000)), factor, periodic=True).std()
    found = []
    for _ in range(40):
        noise = decimate(rng.normal(size=(factor * samples, periods)), factor, periodic=True)
        noise = noise.T[:, :, None] / size
        mean = noise.mean(axis=0)
        system = replace(
            rows(matrix, matrix @ THETA + mean[:, 0]),
            scatter=(noise - mean,),
            filtered=filtered_noise(factor),
        )
        found.append(least_squares(system).std_devs)
    true = np.sqrt(np.diag(inverse @ covariance @ inverse.T) / periods)
    np.testing.assert_allclose(np.mean(found, axis=0), true, rtol=0.1)
    assert (np.std(found, axis=0) < 0.2 * true).all()


def test_lack_of_fit_is_seen_in_the_joint_that_has_it() -> None:
    system = repeated(8)
    nothing = lack_of_fit(system, weighted(system).values)
    assert (nothing.p_value > 0.01).all()
    np.testing.assert_allclose(nothing.ratio, 1.0, atol=0.3)
    missing = system.force.copy()
    missing[:, 1] += 5.0 * np.sin(0.7 * np.arange(200))
    found = lack_of_fit(replace(system, force=missing), weighted(system).values)
    assert found.p_value[1] < 1e-6
    assert found.p_value[0] > 0.01


def test_lack_of_fit_is_wrongly_seen_as_often_as_it_says() -> None:
    """Noise that is correlated over ten samples: fewer independent ones than there are samples."""
    rng = np.random.default_rng(9)
    p_values = []
    for _ in range(300):
        noise = lfilter([1.0], [1.0, -0.9], rng.normal(size=(PERIODS, 500)), axis=1)[:, 200:, None]
        mean = noise.mean(axis=0)
        matrix = columns(300)
        system = replace(rows(matrix, matrix @ THETA + mean[:, 0]), scatter=(noise - mean,))
        p_values.append(lack_of_fit(system, THETA).p_value[0])
    assert 0.01 < np.mean(np.array(p_values) < 0.05) < 0.12


def test_lack_of_fit_of_a_joint_that_stands_still_is_not_known() -> None:
    system = repeated(8)
    used, scatter = system.used.copy(), system.scatter[0].copy()
    used[:, 1], scatter[:, :, 1] = False, 0.0
    still = replace(system, used=used, scatter=(scatter,))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        found = lack_of_fit(still, weighted(still).values)
    assert np.isnan(found.p_value[1])
    assert found.p_value[0] > 0.01


def test_without_repeated_periods_lack_of_fit_is_not_known() -> None:
    left = lack_of_fit(noisy(100, 0.0, np.random.default_rng(10)), THETA)
    assert np.isnan(left.p_value).all()
    assert np.isnan(left.ratio).all()
