"""The position estimator on a machine at work; lost, late, invalid readings; starts not known."""

from dataclasses import replace

import numpy as np
from unit.crane_observer.observed import JOINTS, at_work, known, recording

from crane_observer import HeardRecording, PositionEstimator
from crane_observer.position.estimator import EstimatorCondition, ReadingNoise
from crane_observer.position.replay import EstimatedCourse, replay

ALL = np.ones(3, dtype=bool)


def errors(course: EstimatedCourse) -> np.ndarray:
    """(n, 3) rad, m."""
    made, _ = at_work()
    time = made.time - made.time[0]
    true = [np.interp(course.time, time, made.truth.position[:, 1 + j]) for j in range(3)]
    return course.position - np.stack(true, axis=1)


def observed(hidden: np.ndarray, given: HeardRecording | None = None) -> EstimatedCourse:
    given = given or recording()
    return replay(PositionEstimator(known(), recording().encoders[0]), given, hidden)


def rms(values: np.ndarray) -> np.ndarray:
    return np.asarray(np.sqrt((values**2).mean(axis=0)))


def test_encoders_are_not_needed_from_a_known_start() -> None:
    course = observed(ALL)
    assert (rms(errors(course)) < [2e-3, 2e-3, 5e-3]).all()
    within = np.abs(errors(course)) < 2.5 * course.deviation
    assert within.mean() > 0.95
    assert set(course.conditions) == {EstimatorCondition.GOOD}


def test_an_encoder_that_is_lost_in_mid_motion_is_named_and_replaced() -> None:
    encoders = recording().encoders.copy()
    encoders[len(encoders) // 2 :, 1] = np.nan
    course = observed(~ALL, replace(recording(), encoders=encoders))
    half = course.time > recording().encoder_time[len(encoders) // 2] + 0.2
    assert rms(errors(course)[half])[1] < 2e-3
    lost = [condition is EstimatorCondition.ENCODER_LOST for condition in course.conditions]
    assert not any(np.array(lost)[~half][:-10])
    assert all(np.array(lost)[half])


def test_an_encoder_that_froze_unnoticed_is_not_believed_in_hindsight() -> None:
    """It froze in motion, and was found out a second later: as if it had been lost at once."""
    given = recording()
    speed = np.abs(np.diff(given.encoders[:, 1], prepend=given.encoders[0, 1]))
    begin = int(np.argmax(speed > 0.5 * speed.max()))
    end = begin + 200
    frozen = given.encoders.copy()
    frozen[begin:, 1] = frozen[begin, 1]
    moved = abs(given.encoders[end, 1] - frozen[end, 1])
    assert moved > 0.02
    sensor = PositionEstimator(known(), given.encoders[0])
    replay(sensor, first(replace(given, encoders=frozen), end), ~ALL)
    sensor.distrust(1, given.encoder_time[begin])
    k = end
    told = None
    while told is None:
        sensor.add_encoders(given.encoder_time[k], frozen[k])
        sensor.add_command(given.command_time[k], given.commands[k])
        row = given.chamber_a[k], given.chamber_b[k], float(given.supply[k])
        told = sensor.add_pressures(float(given.pressure_time[k]), *row)
        k += 1
    assert not told.measured[1]
    assert told.condition is EstimatorCondition.ENCODER_LOST
    away = abs(told.estimate.position[1] - given.encoders[k - 1, 1])
    assert away < max(2e-3, 3.0 * told.estimate.deviation[1])
    assert away < 0.1 * moved


def test_a_load_that_comes_unannounced_is_weighed() -> None:
    made, load = at_work()
    course = observed(~ALL)
    carried = np.interp(course.time, made.time - made.time[0], load)
    assert carried.max() > 20.0
    assert course.changed.any()
    sure = course.load_deviation < 5.0
    assert sure.mean() > 0.5
    away = np.abs(course.load - carried)
    assert (away[sure] < 2.5 * course.load_deviation[sure] + 0.5).mean() > 0.95
    assert (away[sure] < 5.0).mean() > 0.95


def test_a_start_that_nobody_knows_is_found() -> None:
    start = recording().encoders[0].copy()
    start[0] = np.nan
    course = replay(PositionEstimator(known(), start), recording(), np.array([True, False, False]))
    assert course.conditions[0] is EstimatorCondition.SEARCHING
    assert course.conditions[-1] is EstimatorCondition.GOOD
    assert abs(errors(course)[-1, 0]) < 5e-3


def first(given: HeardRecording, count: int) -> HeardRecording:
    """Its first samples."""
    parts = {
        name: array[:count] for name, array in vars(given).items() if isinstance(array, np.ndarray)
    }
    return replace(given, **parts)


def without(given: HeardRecording, rows: np.ndarray) -> HeardRecording:
    return replace(
        given,
        pressure_time=given.pressure_time[rows],
        chamber_a=given.chamber_a[rows],
        chamber_b=given.chamber_b[rows],
        supply=given.supply[rows],
    )


def test_pressures_that_are_lost_are_named_and_recovered_from() -> None:
    given = recording()
    begin = int(np.argmax(np.abs(given.commands[:, 0]) > 0.2)) + 100
    gone = (np.arange(len(given.supply)) < begin) | (np.arange(len(given.supply)) >= begin + 60)
    course = observed(ALL, without(given, gone))
    lost = np.array(
        [condition is EstimatorCondition.PRESSURES_LOST for condition in course.conditions]
    )
    assert lost.sum() == 1
    (k,) = np.flatnonzero(lost)
    dead = [joint.valve.dead_band_a.value for joint in known().hydraulics.joints.values()]
    moves = (np.abs(given.commands[begin - 20 : begin + 60]) > dead).any(axis=0)
    assert 0 < moves.sum() < len(moves)  # behind a closed valve nothing can have happened
    grown = course.deviation[k] / course.deviation[k - 1]
    assert (grown[moves] > 5.0).all()
    assert (grown[~moves] < 1.1).all()
    assert course.conditions[-1] is EstimatorCondition.GOOD
    assert (np.abs(errors(course)[-1]) < 4.0 * course.deviation[-1]).all()


def test_a_valve_that_opens_and_closes_within_a_gap_counts_as_open() -> None:
    zeros, resting = np.zeros(3), known_pressures()
    for pulse in (0.04, 3.0):  # s; there are more commands within the longer one than are kept
        sensor = PositionEstimator(known(), recording().encoders[0])
        stamps = np.arange(0.0, 1.0, 0.005)
        for time in stamps:
            sensor.add_command(time, zeros)
            sensor.add_pressures(time, *resting)
        for time in np.arange(1.0, 1.2 + 2.0 * pulse, 0.005):
            sensor.add_command(time, np.array([0.0, 0.5 * (1.03 < time < 1.03 + pulse), 0.0]))
        told = sensor.add_pressures(1.2 + 2.0 * pulse, *resting)
        assert told is not None
        assert told.condition is EstimatorCondition.PRESSURES_LOST
        assert told.estimate.deviation[1] > 0.01


def known_pressures() -> tuple[np.ndarray, np.ndarray, float]:
    """Of a machine that stands, as the recording begins."""
    given = recording()
    return given.chamber_a[0], given.chamber_b[0], float(given.supply[0])


def test_late_and_invalid_readings_change_nothing() -> None:
    given, sensors = (
        recording(),
        [PositionEstimator(known(), recording().encoders[0]) for _ in "ab"],
    )
    for k in range(1000):
        for sensor in sensors:
            sensor.add_encoders(given.encoder_time[k], np.full(3, np.nan))
            row = given.pressure_time[k], given.chamber_a[k], given.chamber_b[k], given.supply[k]
            told = sensor.add_pressures(*row)
            sensor.add_command(given.command_time[k], given.commands[k])
        if k > 10:
            disturbed = sensors[1]
            assert disturbed.add_pressures(given.pressure_time[k - 5], *row[1:]) is None
            assert disturbed.add_pressures(row[0] + 1e-3, row[1] * np.nan, *row[2:]) is None
            disturbed.add_command(given.command_time[k - 5], np.ones(3))
            disturbed.add_command(given.command_time[k] + 1e-3, np.full(3, np.nan))
    assert told is None or np.isfinite(told.estimate.position).all()
    first, second = (sensor.add_pressures(5.1, *row[1:]) for sensor in sensors)
    assert first is not None and second is not None
    np.testing.assert_array_equal(first.estimate.position, second.estimate.position)
    assert (sensors[1].late, sensors[1].invalid) == (2 * 989, 2 * 989)


def test_commands_that_stop_while_a_valve_is_open_are_named() -> None:
    given = recording()
    last = int(np.argmax(np.abs(given.commands[:, 0]) > 0.2)) + 50
    cut = replace(given, command_time=given.command_time[:last], commands=given.commands[:last])
    course = observed(ALL, cut)
    assert course.conditions[-1] is EstimatorCondition.COMMANDS_LOST
    assert course.deviation[-1, 0] > 10.0 * course.deviation[0, 0]


def test_it_costs_little_of_a_cycle() -> None:
    """1 ms a cycle is for all observers together; here with the patience of a busy machine."""
    import time

    observed(ALL)
    begin = time.process_time()
    observed(ALL)
    assert (time.process_time() - begin) / len(recording().supply) < 5e-4
    assert known().joints == JOINTS


def test_readings_tell_their_noise_and_their_rounding() -> None:
    """Of white noise, of steps while the joint moves and rests, and of neither: the least."""
    rng, t = np.random.default_rng(3), np.linspace(0.0, 20.0, 2000)
    moves = np.where(t < 10.0, np.sin(t), np.sin(10.0))
    shown = np.stack(
        [moves + 1e-3 * rng.standard_normal(2000), 0.01 * np.round(moves / 0.01), moves]
    )
    noise = ReadingNoise(3, 1e-4)
    for readings in shown.T:
        noise.add(readings)
    assert 0.8e-3 < noise.deviation[0] < 1.2e-3
    assert 0.5 < noise.deviation[1] / (0.01 / np.sqrt(12.0)) < 2.0
    assert noise.deviation[2] == 1e-4
