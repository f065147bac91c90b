"""Stacked regressor samples per second beside Pinocchio called from Python, in the same run."""

import time
from collections.abc import Callable

import numpy as np
import pinocchio as pin
import pytest
from unit.crane_model.pinocchio_crane import planar_crane, random_bodies

from crane_model import Model, Record, load_model
from crane_model.machine_files import machine_file

REPEATS = 7
AT_LEAST = 5.0  # times as fast


def best_rate(samples: int, function: Callable[[], object]) -> float:
    """Samples per second in the best of several calls, after one that compiles and warms up."""
    function()
    durations = []
    for _ in range(REPEATS):
        start = time.perf_counter()
        function()
        durations.append(time.perf_counter() - start)
    return samples / min(durations)


def stacked_by_pinocchio(q: np.ndarray, v: np.ndarray, a: np.ndarray) -> Callable[[], np.ndarray]:
    model = planar_crane(random_bodies(0))
    data = model.createData()

    def stack() -> np.ndarray:
        stacked = np.empty((len(q), 3, 30))
        for n in range(len(q)):
            stacked[n] = pin.computeJointTorqueRegressor(model, data, q[n], v[n], a[n])
        return stacked

    return stack


@pytest.mark.parametrize("samples", [1_000, 10_000, 100_000])
def test_regressor_is_at_least_five_times_as_fast(samples: int, measured) -> None:
    rng = np.random.default_rng(22)
    q = rng.uniform([-0.45, -2.7, 0.0], [1.37, -0.1, 1.55], (samples, 3))
    v, a = rng.standard_normal((2, samples, 3))
    crane = load_model(machine_file("model.yaml"))
    rigid = Model("rigid bodies", crane.setting, crane.terms[:1])

    def stacked_by(model: Model) -> Callable[[], np.ndarray]:
        instants = np.arange(samples) * 0.005
        return lambda: model.regressor(Record(model.joints, instants, q, v, a))

    pinocchio = best_rate(samples, stacked_by_pinocchio(q, v, a))
    print(f"\n{samples} samples              columns   million samples/s   times Pinocchio")
    print(f"  Pinocchio from Python      30        {pinocchio / 1e6:10.3f}")
    for model in (rigid, crane):
        columns = len(model.parameters)
        rate = best_rate(samples, stacked_by(model))
        ratio = rate / pinocchio
        print(f"  crane_model                {columns:2d}        {rate / 1e6:10.3f}{ratio:18.1f}")
        measured(
            f"regressor of {columns} columns, {samples} samples, against Pinocchio from Python",
            f"{AT_LEAST:g} times",
            "{times:.1f} times, {rate:.1f} million samples/s",
            times=ratio,
            rate=rate / 1e6,
        )
        assert ratio >= AT_LEAST, (
            f"{columns} columns, {samples} samples: {ratio:.1f} times as fast as Pinocchio, "
            f"at least {AT_LEAST} are needed"
        )
