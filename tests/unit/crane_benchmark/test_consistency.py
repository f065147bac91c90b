"""Errors that stay from window to window, as large as they are said to be, or not."""

import numpy as np
import pytest

from crane_benchmark.observing.observer import Consistency, Freedom, of_recordings

MOMENTS, RUNS = 400, 300
NOISE, READING, FADES = 0.1, 2.0, 0.98  # of a walk, of its reading; of an offset


def freedom(transition: np.ndarray, covariance: np.ndarray, places: np.ndarray) -> float:
    found = Freedom(places)
    for _ in range(MOMENTS):
        found.add(transition, covariance)
    return found.value


def test_independent_errors_all_count() -> None:
    white = freedom(np.zeros((3, 3)), np.diag([1.0, 4.0, 9.0]), np.array([0, 2]))
    assert white == pytest.approx(2 * MOMENTS)


def test_errors_that_never_change_count_once() -> None:
    covariance = np.array([[2.0, 0.5], [0.5, 1.0]])
    assert freedom(np.eye(2), covariance, np.array([0, 1])) == pytest.approx(2.0)


def test_errors_that_fade_count_as_their_correlation_says() -> None:
    stay = 0.9  # squares of normal variables are alike by the square of it
    lags = np.arange(1, MOMENTS)
    times = 1.0 + 2.0 * ((1.0 - lags / MOMENTS) * stay ** (2 * lags)).sum()
    assert freedom(stay * np.eye(1), np.eye(1), np.zeros(1, int)) == pytest.approx(MOMENTS / times)


def nees_of_runs() -> tuple[np.ndarray, float]:
    """Mean NEES of each run of a filter of a walk, whose readings share an offset that it considers
    and does not estimate, and the freedom of that mean.
    """
    rng = np.random.default_rng(5)
    walk, offset = np.zeros(RUNS), rng.normal(size=RUNS)
    told, total = np.zeros(RUNS), np.zeros(RUNS)
    P, H, found = np.diag([0.0, 1.0]), np.array([1.0, 1.0]), Freedom(np.zeros(1, int))
    F, Q = np.diag([1.0, FADES]), np.diag([NOISE**2, 1.0 - FADES**2])
    for _ in range(MOMENTS):
        walk += NOISE * rng.normal(size=RUNS)
        offset = FADES * offset + np.sqrt(1.0 - FADES**2) * rng.normal(size=RUNS)
        P = F @ P @ F.T + Q
        gain = np.array([(P @ H)[0] / (H @ P @ H + READING**2), 0.0])
        told += gain[0] * (walk + offset + READING * rng.normal(size=RUNS) - told)
        kept = np.eye(2) - np.outer(gain, H)
        P = kept @ P @ kept.T + READING**2 * np.outer(gain, gain)
        found.add(kept @ F, P)
        total += (told - walk) ** 2 / P[0, 0]
    return total / MOMENTS, found.value


def test_the_band_holds_runs_of_a_filter_that_is_right() -> None:
    nees, freedom = nees_of_runs()
    assert nees.mean() == pytest.approx(1.0, abs=0.1)
    assert 3.0 < freedom < 30.0  # few: errors stay
    assert nees.var() == pytest.approx(2.0 / freedom, rel=0.3)
    assert 0.92 <= np.mean([Consistency(value, freedom).holds for value in nees]) <= 0.98


@pytest.mark.parametrize("size", [0.5, 2.0])
def test_recordings_together_tell_widths_that_are_wrong(size: float) -> None:
    nees, freedom = nees_of_runs()
    together = [
        of_recordings([Consistency(row, freedom) for row in some]) for some in nees.reshape(-1, 10)
    ]
    assert np.mean([row.holds for row in together]) > 0.8
    wrong = [row._replace(nees=size**2 * row.nees) for row in together]
    assert np.mean([row.holds for row in wrong]) < 0.05
