"""Samples per second into the information matrix, beside stacking the regressor first."""

import time
from collections.abc import Callable

import numpy as np
from threadpoolctl import threadpool_limits
from unit.crane_identification.online.online_crane import crane, motion

from crane_identification.scale.information import Information
from crane_model.record import Record

SAMPLES, REPEATS = 200_000, 5


def rate(work: Callable[[], object]) -> float:
    """Samples per second of processor time, the best of several calls: others use the machine."""
    work()
    times = []
    for _ in range(REPEATS):
        begin = time.process_time()
        work()
        times.append(time.process_time() - begin)
    return SAMPLES / min(times)


def test_information_of_a_long_record() -> None:
    model = crane()
    at = np.linspace(0.0, 1000.0, SAMPLES)
    force = np.random.default_rng(0).normal(size=(SAMPLES, 3))
    record = Record(model.joints, at, *motion(at), force=force)

    def stacked() -> None:
        matrix = model.regressor(record).reshape(-1, len(model.parameters))
        matrix.T @ matrix, matrix.T @ force.ravel()

    with threadpool_limits(1):
        ours = rate(lambda: Information.of_records(model, [record]))
        theirs = rate(stacked)
    print(
        f"\ninformation matrix, 3 joints x 20 parameters, one core: {ours / 1e6:.1f} million "
        f"samples/s; regressor stacked first: {theirs / 1e6:.1f} million samples/s"
    )
    assert ours > theirs
