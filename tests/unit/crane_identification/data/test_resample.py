import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from crane_identification import Log, Signal
from crane_identification.data.resample import (
    SHORTEST_RUN,
    interruptions,
    regular,
    resample,
    sampling_rate,
    slowed,
)
from crane_model import DataError

RATE = 200.0


def line(time: np.ndarray, origin: str = "/joint_states") -> Signal:
    """Two joints that move at constant velocity: linear interpolation is exact."""
    return Signal(time, np.column_stack([2.0 * time, 1.0 - time]), origin)


def log_of(position: Signal, pressure: Signal, **more: Signal) -> Log:
    return Log("bag", ("a", "b"), 0, position, pressure_a=pressure, pressure_b=pressure, **more)


def jittered(count: int, seed: int, offset: float = 0.0) -> np.ndarray:
    random = np.random.default_rng(seed)
    return offset + (np.arange(count) + random.uniform(-0.2, 0.2, count)) / RATE


@settings(deadline=None)  # a busy machine is no failure
@given(seed=st.integers(0, 1000), offset=st.floats(-0.5, 0.5))
def test_asynchronous_signals_meet_on_one_time_base(seed: int, offset: float) -> None:
    position, pressure = line(jittered(400, seed)), line(jittered(400, seed + 1, offset))
    samples = resample(log_of(position, pressure))
    assert samples.rate == pytest.approx(RATE, rel=0.002)
    np.testing.assert_allclose(np.diff(samples.time), 1 / samples.rate, rtol=1e-6)
    assert samples.time[0] == max(position.time[0], pressure.time[0])
    end = min(position.time[-1], pressure.time[-1])
    assert end - 1 / samples.rate < samples.time[-1] <= end + 1e-9
    truth = np.column_stack([2.0 * samples.time, 1.0 - samples.time])
    np.testing.assert_allclose(samples.position, truth, atol=1e-8)
    np.testing.assert_allclose(samples.pressure_a, truth, atol=1e-8)
    assert (samples.run == 0).all()


def test_positions_that_are_late_meet_the_pressures_of_their_time() -> None:
    """Each joint by its own latency, up to the last time at which all are known."""
    latency = np.array([0.03, 0.0])
    time, pressure = jittered(400, 1), line(jittered(400, 2))
    shown = np.column_stack([2.0 * (time - 0.03), 1.0 - time])
    samples = resample(log_of(Signal(time, shown, "", latency=latency), pressure))
    truth = np.column_stack([2.0 * samples.time, 1.0 - samples.time])
    np.testing.assert_allclose(samples.position, truth, atol=1e-8)
    np.testing.assert_allclose(samples.pressure_a, truth, atol=1e-8)
    assert samples.time[-1] > min(time[-1], pressure.time[-1]) - 0.03 - 1.0 / RATE


def test_uniform_signals_come_through_unchanged() -> None:
    time = np.arange(1000) / 1000.0
    value = np.random.default_rng(0).normal(size=(1000, 1))
    log = Log("table", ("axis",), 0, Signal(time, value, ""), force=Signal(time, -value, ""))
    samples = resample(log)
    assert samples.rate == 1000.0
    np.testing.assert_array_equal(samples.time, time)
    np.testing.assert_array_equal(samples.position, value)
    np.testing.assert_array_equal(samples.force, -value)


def test_given_rate() -> None:
    time = jittered(400, 0)
    samples = resample(log_of(line(time), line(time)), rate=50.0)
    np.testing.assert_allclose(np.diff(samples.time), 0.02)


def test_sampling_rate_is_not_drawn_by_gaps() -> None:
    time = np.arange(1000) / RATE
    assert sampling_rate(np.delete(time, slice(300, 600))) == pytest.approx(RATE, rel=1e-9)
    assert sampling_rate(np.delete(time, [5, 77, 300])) == pytest.approx(RATE, rel=1e-9)


def with_gap() -> Log:
    """Pressures fail from 1.0 to 1.5 s, positions for a harmless 0.05 s at 2 s."""
    time = np.arange(600) / RATE
    pressure = line(time[(time <= 1.0) | (time >= 1.5)], "/cylinder_pressures")
    return log_of(line(time[(time <= 2.0) | (time >= 2.05)]), pressure)


def test_gap_splits_into_runs_in_step() -> None:
    samples = resample(with_gap())
    assert samples.run[0] == 0
    assert samples.run[-1] == 1
    np.testing.assert_allclose(samples.time[samples.run == 0][-1], 1.0)
    np.testing.assert_allclose(samples.time[samples.run == 1][0], 1.5)
    steps = np.diff(samples.time) * samples.rate
    np.testing.assert_allclose(steps, np.round(steps), atol=1e-6)
    assert np.count_nonzero(steps > 1.5) == 1
    np.testing.assert_allclose(samples.pressure_a[:, 0], 2.0 * samples.time, atol=1e-9)


def test_gap_that_is_allowed() -> None:
    samples = resample(with_gap(), largest_gap=0.6)
    assert (samples.run == 0).all()
    assert len(samples) == 600


def test_nan_of_one_joint_is_a_gap_of_all() -> None:
    time = np.arange(600) / RATE
    position, pressure = line(time), line(time)
    position.value[200:300, 1] = np.nan
    position.value[400, 0] = np.nan
    samples = resample(log_of(position, pressure))
    assert samples.run.max() == 1
    assert len(samples) == 500
    np.testing.assert_allclose(samples.position[:, 0], 2.0 * samples.time, atol=1e-9)


def test_run_that_is_too_short_is_dropped() -> None:
    time = np.arange(600) / RATE
    keep = (time < 1.0) | (time > 2.0)
    keep[300 : 300 + SHORTEST_RUN - 1] = True
    log = log_of(line(time[keep]), line(time[keep]))
    assert set(resample(log).run) == {0, 1}
    keep[300 : 300 + SHORTEST_RUN] = True
    log = log_of(line(time[keep]), line(time[keep]))
    assert set(resample(log).run) == {0, 1, 2}


def test_signals_that_do_not_overlap() -> None:
    time = np.arange(600) / RATE
    with pytest.raises(DataError, match="bag: positions and pressures or forces were never"):
        resample(log_of(line(time), line(time + 10.0)))


def test_sensor_that_is_dead() -> None:
    time = np.arange(600) / RATE
    pressure = line(time, "/cylinder_pressures")
    pressure.value[:, 1] = np.nan
    with pytest.raises(DataError, match="bag: /cylinder_pressures: 0 samples .* a, b"):
        resample(log_of(line(time), pressure))


def test_other_signals() -> None:
    time = np.arange(600) / RATE
    late = time[200:400:10]
    command = Signal(late, np.column_stack([late, -late]), "/valve_command")
    slow = np.arange(4.0)
    samples = resample(
        log_of(
            line(time),
            line(time),
            command=command,
            reference_position=line(late),
            temperature=Signal(slow, 20.0 + slow, ""),
        )
    )
    assert samples.command is not None
    assert samples.reference_position is not None
    assert samples.temperature is not None
    before, during = samples.time < late[0] - 1e-6, slice(200, 391)
    assert np.isnan(samples.command[before]).all()
    np.testing.assert_allclose(samples.command[during, 0], late[np.arange(191) // 10])
    assert np.isnan(samples.reference_position[before]).all()
    assert np.isnan(samples.reference_position[391:]).all()
    np.testing.assert_allclose(samples.reference_position[during, 0], 2.0 * samples.time[during])
    np.testing.assert_allclose(samples.temperature, 20.0 + samples.time)
    assert samples.velocity is samples.slew_position is samples.supply_pressure is None


def test_other_signals_are_bridged_for_a_moment_and_unknown_for_longer() -> None:
    """Each column for itself: what one joint lacks is no matter of the others."""
    time = np.arange(600) / RATE
    command, supply = line(time), Signal(time, np.cos(time), "")
    command.value[100:110, 0] = np.nan  # 0.05 s
    command.value[200:300, 0] = np.nan  # 0.5 s
    supply.value[100:110] = supply.value[400:] = np.nan
    samples = resample(log_of(line(time), line(time), command=command, supply_pressure=supply))
    assert samples.command is not None and samples.supply_pressure is not None
    known = np.isfinite(samples.command)
    assert known[:, 1].all()
    lost = np.flatnonzero(~known[:, 0])
    assert (lost[0], lost[-1]) == (220, 299)  # held for 0.1 s
    np.testing.assert_array_equal(samples.command[100:110, 0], samples.command[99, 0])
    np.testing.assert_allclose(samples.supply_pressure[:400], np.cos(time[:400]), atol=1e-3)
    assert np.isnan(samples.supply_pressure[400:]).all()


def test_a_lower_rate_brings_no_aliases() -> None:
    """At 80 Hz, 70 Hz would come back as 10 Hz; what is slow stays as it is."""
    time = np.arange(0.0, 10.0, 1e-3)
    slow = np.column_stack([np.sin(2.0 * time), np.cos(3.0 * time)])
    noisy = slow + 0.1 * np.sin(2 * np.pi * 70.0 * time)[:, np.newaxis]
    log = slowed(log_of(Signal(time, noisy, "made"), Signal(time, noisy, "made")), 80.0)
    for signal in (log.position, log.pressure_a):
        assert signal is not None
        at = signal.time[10:-10]
        assert sampling_rate(signal.time) == pytest.approx(80.0)
        expected = np.column_stack([np.sin(2.0 * at), np.cos(3.0 * at)])
        np.testing.assert_allclose(signal.value[10:-10], expected, atol=1e-3)


def test_a_lower_rate_keeps_gaps_and_slower_signals() -> None:
    time = np.arange(0.0, 10.0, 1e-3)
    kept = (time < 4.0) | (time > 6.0)
    coarse = np.arange(0.0, 10.0, 0.02)
    position = line(time[kept])
    log = slowed(log_of(position, line(coarse)), 100.0)
    ((begin, length),) = interruptions(log.position)
    assert (begin, length) == (pytest.approx(4.0, abs=0.02), pytest.approx(2.0, abs=0.03))
    assert log.pressure_a is not None and len(log.pressure_a.time) == len(coarse)
    assert log.position.resolution is not None
    same = log_of(position, line(coarse))
    assert slowed(same, None) is same


def swinging(time: np.ndarray, stamps: np.ndarray) -> Log:
    """A joint that swings and one that stands, measured at `time` and stamped `stamps`."""
    noise = 1e-5 * np.random.default_rng(0).normal(size=(len(time), 2))
    value = noise + np.column_stack([np.sin(1.5 * time), np.zeros(len(time))])
    return log_of(Signal(stamps, value, "states"), Signal(stamps, value, "states"))


@pytest.mark.parametrize("lost", [0.0, 0.1])
@pytest.mark.parametrize("jitter", [0.3, 0.05])
def test_stamps_that_jitter_around_regular_samples_are_put_right(
    lost: float, jitter: float
) -> None:
    random = np.random.default_rng(3)
    true = 1e-3 * np.flatnonzero(random.uniform(size=20000) >= lost)
    stamps = true + 1e-3 * random.uniform(-jitter, jitter, len(true))
    log = regular(swinging(true, stamps))
    np.testing.assert_allclose(log.position.time, true, atol=2e-5)
    assert log.pressure_a is not None and log.pressure_a.time is log.position.time
    (note,) = log.notes
    assert "1 ms apart" in note


def test_stamps_that_tell_when_samples_were_taken_stay() -> None:
    time = jittered(4000, 5)
    for stamps in (time, np.cumsum(np.random.default_rng(6).uniform(1e-3, 9e-3, 4000))):
        log = swinging(stamps, stamps)
        assert regular(log) is log
    drifting = np.arange(20000) * 1e-3
    slow = drifting + 0.01 * np.sin(0.2 * drifting)  # a clock that wanders by ten samples
    log = swinging(drifting, slow)
    assert regular(log) is log
