"""What a row costs in the recursion, beside filterpy's Kalman filter in the same run."""

import time
from collections.abc import Callable

import numpy as np
import pytest
from filterpy.kalman import KalmanFilter
from unit.crane_identification.online.online_crane import RATE, crane, motion, record_log

from crane_identification.online.recursion import Recursion
from crane_identification.online.replay import replay
from crane_model import Record

JOINTS, PARAMETERS, ROWS, REPEATS = 3, 20, 2000, 5


@pytest.fixture(scope="module")
def rows() -> tuple[np.ndarray, np.ndarray]:
    """Regressor (n, 3, 20) of the crane in motion, and forces (n, 3)."""
    at = np.linspace(1.0, 41.0, ROWS)
    matrix = crane().regressor(Record(crane().joints, at, *motion(at)))
    return matrix, np.random.default_rng(0).normal(size=(ROWS, JOINTS))


def best(work: Callable[[], None]) -> float:
    """Processor time [us] a row, the best of several runs: others use this machine too."""
    times = []
    for _ in range(REPEATS):
        begin = time.process_time()
        work()
        times.append(time.process_time() - begin)
    return min(times) / ROWS * 1e6


def test_update_beside_filterpy(rows: tuple[np.ndarray, np.ndarray], measured) -> None:
    matrix, force = rows
    used, weights = np.ones(JOINTS, dtype=bool), np.ones(JOINTS)
    recursion = Recursion(JOINTS, PARAMETERS, 0.999)
    recursion.update(matrix[0], force[0], used)
    recursion.values(weights)  # compiles

    def update() -> None:
        for row, tau in zip(matrix, force, strict=True):
            recursion.update(row, tau, used)

    def read() -> None:
        for _ in range(ROWS):
            recursion.values(weights)

    kalman = KalmanFilter(dim_x=PARAMETERS, dim_z=JOINTS)
    kalman.P *= 1e6

    def filterpy() -> None:
        for row, tau in zip(matrix, force, strict=True):
            kalman.update(tau[:, None], H=row)

    ours, values, theirs = best(update), best(read), best(filterpy)
    solve = best(lambda: [recursion.solve() for _ in range(20)] and None) * ROWS / 20
    print(
        f"\nrecursion, 3 joints x 20 parameters: {ours:.1f} us an update, {values:.1f} us to read "
        f"the values, {solve:.0f} us to read values and covariance; "
        f"filterpy's KalmanFilter: {theirs:.1f} us an update"
    )
    measured(
        "recursive update of 20 parameters x 3 joints; filterpy's KalmanFilter",
        "under 30 µs",
        "{ours:.1f}; {filterpy:.1f} µs",
        ours=ours,
        filterpy=theirs,
    )
    assert ours < 30.0
    assert ours < theirs


def test_whole_estimator_from_readings_to_rows(measured) -> None:
    log, spent = record_log(20.0), []
    replay(crane(), record_log(4.0))  # compiles
    for _ in range(REPEATS):
        begin = time.process_time()
        replay(crane(), log)
        spent.append(time.process_time() - begin)
    sample = min(spent) / len(log.position.time) * 1e6
    print(
        f"\nonline estimator: {sample:.0f} us a sample, "
        f"{100 * min(spent) / 20.0:.1f} % of one core at {RATE:.0f} Hz"
    )
    measured("online estimator, from readings to Θ", "50 µs a sample", "{whole:.0f}", whole=sample)
    assert sample <= 50.0
