"""Samples per second into the information matrix, beside stacking the regressor first; time and
memory over the number of recordings."""

import time
import tracemalloc
from collections.abc import Callable

import numpy as np
import pytest
from threadpoolctl import threadpool_limits
from unit.crane_identification.online.online_crane import crane, motion

from crane_identification.scale.summed import Information
from crane_model.record import Record

SAMPLES, REPEATS = 50_000, 25
AT_LEAST = 3e6  # samples/s


def best(work: Callable[[], object]) -> float:
    """Processor time [s], the best of several calls: others use the machine."""
    work()
    times = []
    for _ in range(REPEATS):
        begin = time.process_time()
        work()
        times.append(time.process_time() - begin)
    return min(times)


@pytest.fixture(scope="module")
def record() -> Record:
    at = np.linspace(0.0, 1000.0, SAMPLES)
    force = np.random.default_rng(0).normal(size=(SAMPLES, 3))
    return Record(crane().joints, at, *motion(at), force=force)


def test_information_of_a_long_record(record: Record, measured) -> None:
    model, force = crane(), record.force
    assert force is not None

    def stacked() -> None:
        matrix = model.regressor(record).reshape(-1, len(model.parameters))
        matrix.T @ matrix, matrix.T @ force.ravel()

    with threadpool_limits(1):
        ours = SAMPLES / best(lambda: Information.of_records(model, [record]))
        theirs = SAMPLES / best(stacked)
    print(
        f"\ninformation matrix, 3 joints x 20 parameters, one core: {ours / 1e6:.1f} million "
        f"samples/s; regressor stacked first: {theirs / 1e6:.1f} million samples/s"
    )
    measured(
        "information matrix ΦᵀΦ, Φᵀτ, 20 columns, 3 joints, one core",
        "3 million samples/s",
        "{ours:.1f} million samples/s; regressor stacked first: {stacked:.1f}",
        ours=ours / 1e6,
        stacked=theirs / 1e6,
    )
    assert ours >= AT_LEAST
    assert ours > theirs


def test_time_is_linear_and_memory_constant(record: Record, measured) -> None:
    model = crane()

    def seconds(records: int) -> float:
        return best(lambda: Information.of_records(model, [record] * records))

    def peak(records: int) -> int:
        tracemalloc.start()
        Information.of_records(model, [record] * records)
        size = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        return size

    with threadpool_limits(1):
        each = [seconds(records) / records for records in (4, 32)]
    memory = [peak(records) for records in (4, 32)]
    measured(
        "32 recordings beside 4: time a recording, memory",
        "the same",
        "{time:.2f}, {memory:.2f} times",
        time=each[1] / each[0],
        memory=memory[1] / memory[0],
    )
    assert 0.7 < each[1] / each[0] < 1.4
    assert memory[1] < 1.1 * memory[0]
