"""From damaged bags to Θ: what can be mended is, and told; else bag, topic and time are refused."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from unit.crane_identification.experiments import experiment
from unit.crane_identification.synthetic import crane_model

from crane_bags import BagWriter
from crane_bags.types import CYLINDER_PRESSURES, JOINT_REFERENCE, JOINT_STATES
from crane_identification import FitResult, Log, Options, fit, read_bag
from crane_identification.data.bad_samples import usable
from crane_identification.report.findings import findings
from crane_model import DataError

START = 1_700_000_000_000_000_000
JOINTS = crane_model().joints
REVERSED = JOINTS[::-1]
Damage = Callable[[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]
"""Of stamps (n,) [ns] and values (n, ...); returns them changed."""


@pytest.fixture(scope="module")
def recording() -> Log:
    return experiment(5, periods=3)


@pytest.fixture(scope="module")
def sound(recording: Log) -> FitResult:
    return fit(crane_model(), [recording])


def write(path: Path, log: Log, states: Damage, pressures: Damage) -> Path:
    """A bag whose messages list the joints the other way round."""
    assert log.pressure_a and log.pressure_b and log.reference_position
    assert log.reference_velocity and log.reference_acceleration
    stamps = START + np.round(1e9 * log.position.time).astype(np.int64)
    position = states(stamps, log.position.value[:, ::-1])
    both = np.stack([log.pressure_a.value, log.pressure_b.value], axis=1)[:, :, ::-1]
    pressure = pressures(stamps, both)
    nothing = np.full(3, np.nan)
    with BagWriter(path) as bag:
        joint_states = bag.add_arrays(JOINT_STATES, REVERSED)
        cylinders = bag.add_arrays(CYLINDER_PRESSURES, REVERSED)
        references = bag.add_arrays(JOINT_REFERENCE, JOINTS)
        for k, (stamp, q) in enumerate(zip(*position, strict=True)):
            joint_states.write(START + k, int(stamp), q, nothing, nothing)
        for k, (stamp, p) in enumerate(zip(*pressure, strict=True)):
            cylinders.write(START + k, int(stamp), p[0], p[1], np.nan, np.nan)
        motion = (log.reference_position, log.reference_velocity, log.reference_acceleration)
        for k, stamp in enumerate(stamps):
            references.write(int(stamp), int(stamp), *(signal.value[k] for signal in motion))
    return path


def untouched(stamp: np.ndarray, value: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    return stamp, value


def worn(stamp: np.ndarray, value: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """One message in fifty lost, one repeated, one NaN; stamps off by up to 0.2 ms."""
    rng = np.random.default_rng(6)
    value = value.copy()
    value[rng.random(len(value)) < 0.02] = np.nan
    jittered = stamp + rng.integers(-200_000, 200_000, len(stamp))
    times = rng.choice([0, 1, 2], size=len(stamp), p=[0.02, 0.96, 0.02])
    return np.repeat(jittered, times), np.repeat(value, times, axis=0)


def test_worn_bags_give_the_same_parameters(
    tmp_path: Path, recording: Log, sound: FitResult
) -> None:
    """Jitter, repetitions, losses, NaN, joints in another order: no worse than noise."""
    log = read_bag(write(tmp_path / "worn", recording, worn, worn), JOINTS)
    found = fit(crane_model(), [log])
    deviation = np.abs(found.estimate.values - sound.estimate.values) / found.estimate.std_devs
    assert deviation.max() < 3.0
    truth = crane_model().theta
    assert (np.abs(found.estimate.values - truth) < 4.0 * found.estimate.std_devs).all()
    assert any("repeated stamps dropped" in note for note in findings(found, [log]))


def holed(stamp: np.ndarray, value: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """One in twenty of each channel by itself holds no number, in runs of up to ten."""
    rng = np.random.default_rng(9)
    value = value.copy()
    for channel in np.moveaxis(value.reshape(len(value), -1), 1, 0):
        for begin in rng.integers(0, len(value) - 10, len(value) // 110):
            channel[begin : begin + rng.integers(1, 11)] = np.nan
    return stamp, value


def test_short_runs_without_a_number_are_bridged(
    tmp_path: Path, recording: Log, sound: FitResult
) -> None:
    """Of nine channels together more than a third of the time: each has neighbours of its own."""
    log = usable(read_bag(write(tmp_path / "holed", recording, holed, holed), JOINTS))
    assert 0.04 < np.isnan(log.position.value).mean() < 0.06
    found = fit(crane_model(), [log])
    (part,) = found.preparations
    assert part.averaging is not None
    assert part.averaging.used == 3
    deviation = np.abs(found.estimate.values - sound.estimate.values) / found.estimate.std_devs
    assert deviation.max() < 3.0
    warnings = findings(found, [log])
    for channel in ("position of telescope", "pressure b of inner boom"):
        assert any(channel.replace(" boom", "_boom") in warning for warning in warnings)


def test_one_message_of_a_topic_is_an_error_that_names_it(tmp_path: Path, recording: Log) -> None:
    def first(stamp: np.ndarray, value: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return stamp[:1], value[:1]

    for states, pressures, topic in (
        (first, untouched, "/joint_states"),
        (untouched, first, "/cylinder_pressures"),
    ):
        path = write(tmp_path / topic.strip("/"), recording, states, pressures)
        log = usable(read_bag(path, JOINTS))
        for options in (Options(), Options(average=False), Options(period=20.0)):
            with pytest.raises(DataError, match=f"{topic}: 1 samples that hold a number"):
                fit(crane_model(), [log], options)


def test_a_clock_that_leaps_is_named(recording: Log) -> None:
    """As in a table whose last rows were stamped by another clock."""
    time = recording.position.time.copy()
    time[-3:] += 1e9
    log = replace(recording, position=replace(recording.position, time=time))
    with pytest.raises(
        DataError, match=r"/joint_states: 1e\+09 s from the first to the last stamp"
    ):
        fit(crane_model(), [log])


def test_an_untouched_bag_is_the_log(tmp_path: Path, recording: Log, sound: FitResult) -> None:
    log = read_bag(write(tmp_path / "sound", recording, untouched, untouched), JOINTS)
    found = fit(crane_model(), [log])
    np.testing.assert_allclose(found.estimate.values, sound.estimate.values, rtol=1e-4)


def test_gaps_are_left_out_and_told(tmp_path: Path, recording: Log) -> None:
    """Two seconds without pressures in the first period, and encoders that say NaN for one."""

    def silent(stamp: np.ndarray, value: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        kept = ~((stamp - START > 2e9) & (stamp - START < 4e9))
        return stamp[kept], value[kept]

    def blind(stamp: np.ndarray, value: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        value = value.copy()
        value[(stamp - START > 1e9) & (stamp - START < 2e9)] = np.nan
        return stamp, value

    log = read_bag(write(tmp_path / "gaps", recording, blind, silent), JOINTS)
    found = fit(crane_model(), [log])
    (part,) = found.preparations
    assert part.averaging is not None
    assert part.averaging.used == 2
    assert part.averaging.incomplete == pytest.approx(16.0, abs=0.2)
    assert any("16.0 s fill no whole period" in note for note in findings(found, [log]))


def test_a_sensor_that_never_speaks_is_refused_by_bag_and_topic(
    tmp_path: Path, recording: Log
) -> None:
    def dead(stamp: np.ndarray, value: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        value = value.copy()
        value[..., 1] = np.nan
        return stamp, value

    for states, pressures, topic in (
        (dead, untouched, "/joint_states"),
        (untouched, dead, "/cylinder_pressures"),
    ):
        path = tmp_path / topic.strip("/")
        log = read_bag(write(path, recording, states, pressures), JOINTS)
        with pytest.raises(DataError, match=f"{path}: {topic}: 0 samples"):
            fit(crane_model(), [log])


def test_a_clock_that_steps_back_is_refused_by_bag_topic_and_stamp(
    tmp_path: Path, recording: Log
) -> None:
    def stepping(stamp: np.ndarray, value: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return np.where(np.arange(len(stamp)) < 6000, stamp, stamp - 5_000_000_000), value

    path = write(tmp_path / "stepping", recording, stepping, untouched)
    with pytest.raises(
        DataError, match=f"{path}: topic /joint_states: the clock steps back by 4.9"
    ):
        read_bag(path, JOINTS)


def test_no_whole_period_between_gaps_is_refused(tmp_path: Path, recording: Log) -> None:
    """A second is missing every fifteen."""

    def torn(stamp: np.ndarray, value: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        kept = (stamp - START) % 15_000_000_000 > 1_000_000_000
        return stamp[kept], value[kept]

    log = read_bag(write(tmp_path / "torn", recording, torn, untouched), JOINTS)
    with pytest.raises(DataError, match="torn: no whole period of 20 s without a gap"):
        fit(crane_model(), [log])
    assert len(fit(crane_model(), [log], Options(average=False)).preparations) == 4
