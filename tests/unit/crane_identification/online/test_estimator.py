"""Readings in, estimates out, on a crane that obeys the model."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from unit.crane_identification.online.online_crane import (
    ENCODER,
    STANDS,
    START,
    SWING,
    TRUE_VALUES,
    crane,
    record_log,
)
from unit.crane_identification.synthetic import AXIS_THETA, axis_log, axis_model

from crane_identification import Log, Signal
from crane_identification.estimation.least_squares import least_squares
from crane_identification.estimation.regression import Rows
from crane_identification.online.estimator import Forces, OnlineEstimator, OnlineOptions
from crane_identification.online.replay import recursion, replay
from crane_model import ConfigurationError, DataError, generalized_forces, load_model
from crane_model.machine_files import machine_file

JOINTS = ("inner_boom", "outer_boom", "telescope")


@pytest.fixture(scope="module")
def log() -> Log:
    return record_log(42.0)


@pytest.fixture(scope="module")
def learned(log: Log) -> tuple[OnlineEstimator, list[Forces]]:
    return replay(crane(), log)


def test_true_parameters_are_found(learned: tuple[OnlineEstimator, list[Forces]]) -> None:
    solution = learned[0].solve()
    errors = (solution.values - TRUE_VALUES) / solution.std_devs
    assert solution.determined.all()
    assert (np.abs(errors) < 4.0).all()
    assert np.median(solution.std_devs / TRUE_VALUES) < 0.05


def test_standard_deviations_are_those_of_many_recordings() -> None:
    errors = []
    for seed in range(5):
        solution = replay(crane(), record_log(22.0, seed))[0].solve()
        errors.append((solution.values - TRUE_VALUES) / solution.std_devs)
    assert 0.7 < np.sqrt(np.mean(np.square(errors))) < 1.5


Kept = tuple[np.ndarray, np.ndarray, np.ndarray]


def with_rows(log: Log, monkeypatch: pytest.MonkeyPatch) -> tuple[OnlineEstimator, Kept]:
    """An estimator that was fed, and its rows: columns (n, 3, p), force and use (n, 3)."""
    kept: list[Kept] = []
    estimator = OnlineEstimator(crane())
    update = estimator._recursion.update

    def keep(matrix: np.ndarray, force: np.ndarray, used: np.ndarray) -> None:
        kept.append((matrix, force, used))
        update(matrix, force, used)

    monkeypatch.setattr(estimator._recursion, "update", keep)
    feed(estimator, log)
    matrix, force, used = (np.array(part) for part in zip(*kept, strict=True))
    return estimator, (matrix, force, used)


def test_rows_of_a_crane_that_swings_on_its_oil_are_as_true_as_others(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Without noise, true_values parameters leave no more than the encoders' counts explain.

    Columns of a motion smoothed over the whole lag leave 4.4 N m and 1.7 N of this swing.
    """
    log = record_log(14.0, noise=0.0, swing=SWING)
    matrix, force, used = with_rows(log, monkeypatch)[1]
    left = np.where(used, force - matrix @ TRUE_VALUES, 0.0)
    assert (np.sqrt((left**2).sum(axis=0) / used.sum(axis=0)) < [2.0, 1.0, 0.3]).all()


def test_it_is_the_batch_solution_of_its_own_rows(
    log: Log, monkeypatch: pytest.MonkeyPatch
) -> None:
    """At forgetting factor 1, to 1e-8."""
    estimator, (matrix, force, used) = with_rows(log, monkeypatch)
    names = tuple(p.name for p in estimator.model.parameters)
    units = tuple(p.unit for p in estimator.model.parameters)
    time, run = np.arange(len(used)) * 0.05, np.zeros(len(used), dtype=int)
    batch = least_squares(Rows(JOINTS, names, units, time, run, matrix, force, used))
    solution = estimator.solve()
    np.testing.assert_allclose(solution.values, batch.values, rtol=1e-8)
    np.testing.assert_allclose(solution.std_devs, batch.std_devs, rtol=0.5)
    assert batch.samples == estimator.samples


def feed(estimator: OnlineEstimator, log: Log, burst: int = 1) -> list[Forces]:
    """Readings in bursts of one stream, as topics may deliver them."""
    assert log.pressure_a and log.pressure_b
    out = []
    stamps = [
        log.start + np.round(s.time * 1e9).astype(int) for s in (log.position, log.pressure_a)
    ]
    for begin in range(0, len(stamps[0]), burst):
        for i in range(begin, min(begin + burst, len(stamps[0]))):
            out += estimator.add_position(int(stamps[0][i]), log.position.value[i])
        for i in range(begin, min(begin + burst, len(stamps[1]))):
            out += estimator.add_pressure(
                int(stamps[1][i]), log.pressure_a.value[i], log.pressure_b.value[i]
            )
    return out


def test_the_interleaving_of_the_streams_does_not_matter() -> None:
    log = record_log(6.0)
    results = []
    for burst in (1, 7, 300):
        estimator = OnlineEstimator(crane())
        feed(estimator, log, burst)
        results.append(estimator._recursion.values(np.ones(3)))
    np.testing.assert_array_equal(results[0], results[1])
    np.testing.assert_array_equal(results[0], results[2])


def test_predicted_forces_follow_the_measured_ones(
    learned: tuple[OnlineEstimator, list[Forces]],
) -> None:
    late = [row for row in learned[1] if row.stamp > START + 30e9]
    measured, predicted = (np.array([getattr(f, n) for f in late]) for n in Forces._fields[1:3])
    used = np.array([f.used for f in late])
    error = np.where(used, predicted - measured, 0.0)
    assert (np.linalg.norm(error, axis=0) < 0.02 * np.linalg.norm(measured, axis=0)).all()
    early = [row for row in learned[1] if row.stamp < START + STANDS * 1e9]
    assert early and np.isnan([row.predicted for row in early]).all()


def test_nothing_is_learned_at_standstill(log: Log) -> None:
    estimator = OnlineEstimator(crane(), OnlineOptions(forgetting=0.99))
    feed(estimator, log)
    assert log.pressure_a and log.pressure_b
    end = log.start + int(log.position.time[-1] * 1e9)
    rng = np.random.default_rng(0)
    found = []
    for k in range(1, 4000):
        wobble = ENCODER * rng.integers(0, 2, 3)  # the last count of the encoder
        stamp = end + k * 5_000_000
        estimator.add_position(stamp, log.position.value[-1] + wobble)
        estimator.add_pressure(stamp, log.pressure_a.value[-1], log.pressure_b.value[-1])
        if k == 200:  # the last of the motion has come out of the smoother
            found.append((estimator.samples, estimator.solve()))
    found.append((estimator.samples, estimator.solve()))
    (learned, before), (still, after) = found
    assert still == learned > 1000
    np.testing.assert_array_equal(after.std_devs, before.std_devs)
    np.testing.assert_array_equal(after.values, before.values)


def test_a_reset_forgets_everything(learned: tuple[OnlineEstimator, list[Forces]]) -> None:
    log = record_log(6.0)
    estimator = OnlineEstimator(crane())
    feed(estimator, record_log(8.0, seed=3))
    estimator.reset()
    assert (estimator.samples, estimator.matcher.matched, estimator.rows) == (0, 0, 0)
    feed(estimator, log)
    fresh = OnlineEstimator(crane())
    feed(fresh, log)
    np.testing.assert_array_equal(estimator.solve().values, fresh.solve().values)


def test_lost_readings_begin_a_new_run_and_spoil_nothing(log: Log) -> None:
    kept = np.ones(len(log.position.time), dtype=bool)
    kept[3000:3100] = False  # 0.5 s
    position = Signal(log.position.time[kept], log.position.value[kept], "/joint_states")
    estimator, _ = replay(crane(), replace(log, position=position))
    solution = estimator.solve()
    assert estimator.smoother.run == 1
    assert (np.abs(solution.values - TRUE_VALUES) < 4.0 * solution.std_devs).all()


def test_readings_that_are_no_numbers_are_counted_and_left_out(log: Log) -> None:
    value = log.position.value.copy()
    value[500] = np.nan
    position = Signal(log.position.time, value, "/joint_states")
    assert log.pressure_a is not None
    oil = log.pressure_a.value.copy()
    oil[600, 1] = np.inf
    pressure_a = replace(log.pressure_a, value=oil)
    estimator, _ = replay(crane(), replace(log, position=position, pressure_a=pressure_a))
    assert estimator.invalid == 2
    assert estimator.smoother.run == 0
    assert (np.abs(estimator.solve().values - TRUE_VALUES) < 4.0 * estimator.solve().std_devs).all()


def test_fitted_model_names_what_is_not_determined() -> None:
    estimator = OnlineEstimator(crane())
    feed(estimator, record_log(1.0))
    with pytest.raises(DataError, match=r"0 rows do not determine J_FL, .*excite"):
        estimator.fitted_model()


def test_fitted_model_has_values_and_provenance(
    learned: tuple[OnlineEstimator, list[Forces]],
) -> None:
    model = learned[0].fitted_model()
    assert model.values is not None
    assert model.provenance.startswith("recursive least squares, forgetting 1, ")


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (OnlineOptions(lag=0.1), "an eighth of the lag, 0.0125 s, got 0.025"),
        (OnlineOptions(period=0.3), "at most the lag, 0.2 s, got 0.3"),
        (OnlineOptions(forgetting=1.1), "forgetting .* got 1.1"),
        (OnlineOptions(encoder_resolution=(1e-4,)), "one positive value each for inner_boom"),
        (OnlineOptions(encoder_resolution=(1e-4, 0.0, 1e-4)), "one positive value each"),
    ],
)
def test_impossible_options_are_refused(options: OnlineOptions, message: str) -> None:
    with pytest.raises(ConfigurationError, match=message):
        OnlineEstimator(crane(), options)


def test_a_model_without_a_machine_is_refused() -> None:
    model = load_model(machine_file("model.yaml"))
    bare = replace(model, setting=model.setting._replace(machine=None))
    with pytest.raises(ConfigurationError, match="has no machine"):
        OnlineEstimator(bare)


def test_a_log_without_pressures_is_refused(log: Log) -> None:
    with pytest.raises(DataError, match="neither generalized forces nor chamber pressures"):
        replay(crane(), replace(log, pressure_a=None))


def test_forces_serve_as_pressures_do(
    learned: tuple[OnlineEstimator, list[Forces]], log: Log
) -> None:
    """Measured as such, of a model that need not know its cylinders."""
    machine = crane().machine
    assert machine is not None and log.pressure_a is not None and log.pressure_b is not None
    time = log.pressure_a.time
    position = np.column_stack(
        [np.interp(time, log.position.time, column) for column in log.position.value.T]
    )
    chambers = log.pressure_a.value, log.pressure_b.value
    force = generalized_forces(machine, position, *chambers, crane().joints)
    log = replace(log, force=Signal(time, force, "effort"), pressure_a=None, pressure_b=None)
    estimator, forces = replay(crane(), log)
    expected = learned[0].solve()
    assert estimator.samples == learned[0].samples
    deviation = (estimator.solve().values - expected.values) / expected.std_devs
    assert np.abs(deviation).max() < 0.5
    assert len(forces) == len(learned[1])


@pytest.mark.parametrize("slower", [1.0, 5.0])
def test_the_recursion_over_an_axis_with_measured_force(slower: float, tmp_path: Path) -> None:
    """At 100 and at 20 Hz; its encoder is known from the readings alone."""
    model, logs = axis_model(tmp_path), []
    for seed in (1, 2):
        log = axis_log(seed, axis_model(tmp_path), periods=2)
        assert log.force is not None
        kept = np.arange(0, len(log.position.time), round(slower))
        logs.append(replace(log, position=log.position.take(kept), force=log.force.take(kept)))
    found = recursion(model, logs)
    assert found.samples > 100
    np.testing.assert_allclose(found.values[-1], AXIS_THETA, rtol=0.05)
