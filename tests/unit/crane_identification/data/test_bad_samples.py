"""Samples that cannot be what was measured are found, named and left out; sound ones never."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from crane_identification import Log, Signal
from crane_identification.data.bad_samples import usable
from crane_model import DataError

RATE = 200.0
COUNT = 1e-4  # rad or m, of the encoders
JOINTS = ("boom", "telescope")


def recording(seed: int = 0, rate: float = RATE, jitter: float = 2e-4) -> Log:
    """Sixty seconds: harmonics, rests of some seconds, an end stop that is hit; noisy pressures."""
    rng = np.random.default_rng(seed)
    time = np.arange(0.0, 60.0, 1 / rate)
    time = np.sort(time + jitter * rng.uniform(size=len(time)))
    phase = 2 * np.pi / 20 * (time - np.clip(time - 25.0, 0.0, 4.0))  # rests from 25 s to 29 s
    boom = 0.6 * np.sin(phase) + 0.1 * np.sin(5 * phase + 1)
    telescope = np.minimum(0.4 + 0.4 * np.sin(phase + 2), 0.7)  # the stop
    position = np.stack([boom, telescope], axis=1)
    pressure = 5e6 + 3e6 * np.sign(np.sin(3 * position)) + 2e4 * rng.normal(size=position.shape)
    return Log(
        source="bag",
        joints=JOINTS,
        start=0,
        position=Signal(time, COUNT * np.round(position / COUNT), "/joint_states"),
        pressure_a=Signal(time, pressure, "/cylinder_pressures"),
        pressure_b=Signal(time, 8e6 - pressure, "/cylinder_pressures"),
    )


def changed(log: Log, j: int, rows: object, value: object, add: bool = True) -> Log:
    position = log.position.value.copy()
    position[rows, j] = position[rows, j] + value if add else value  # type: ignore[index]
    return replace(log, position=replace(log.position, value=position))


def left_out(log: Log, j: int = 1) -> list[int]:
    return np.flatnonzero(np.isnan(usable(log).position.value[:, j])).tolist()


@pytest.mark.parametrize("rate", [20.0, 50.0, 200.0, 1000.0])
def test_sound_samples_are_never_left_out(rate: float) -> None:
    for seed in range(3):
        log = recording(seed, rate, jitter=0.05 / rate)
        assert usable(log).notes == ()


@pytest.mark.parametrize("size", [8e-4, -1e-3, 0.01, -0.5, 1e3])
@pytest.mark.parametrize("row", [0, 1, 7000, 7453, 11_999])
def test_one_bad_sample_is_found_and_named(size: float, row: int) -> None:
    """Where the joint moves, hits its stop or rests, and at both ends."""
    log = usable(changed(recording(), 1, row, size))
    assert np.argwhere(np.isnan(log.position.value)).tolist() == [[row, 1]]
    (warning,) = log.warnings
    assert warning.startswith("bag: position of telescope (/joint_states): 1 sample left out")
    assert f"sample {row} at " in warning


@pytest.mark.parametrize("length", [1, 2, 7, 18])
def test_what_drops_to_zero_for_a_moment_is_left_out(length: int) -> None:
    rows = [*range(3000, 3000 + length), *range(9000, 9000 + length)]
    assert left_out(changed(recording(), 0, rows, 0.0, add=False), 0) == rows


def test_a_burst_of_noise_is_left_out() -> None:
    burst = np.random.default_rng(1).choice([-0.05, 0.05], 12) * np.linspace(1, 2, 12)
    rows = list(range(4000, 4012))
    found = left_out(changed(recording(), 1, rows, burst))
    assert set(found) <= set(rows)
    assert len(found) >= 11  # what lies on the way is none


def test_a_dropout_of_a_second_becomes_a_gap() -> None:
    rows = list(range(3000, 3200))
    assert left_out(changed(recording(), 0, rows, 0.0, add=False), 0) == rows


def test_a_count_that_is_lost_is_refused() -> None:
    log = changed(recording(), 0, slice(6000, None), 2 * np.pi)
    message = r"bag: position of boom \(/joint_states\): jumps from .* at sample 6000, 30 s, and"
    with pytest.raises(DataError, match=message):
        usable(log)
    for begin, end in ((0.0, 29.9), (30.1, 60.0)):
        assert usable(log, begin, end).notes == ()


def test_a_sensor_that_is_mostly_wrong_is_refused() -> None:
    rng = np.random.default_rng(2)
    for share, refused in ((0.02, False), (0.08, True)):
        rows = np.flatnonzero(rng.random(12_000) < share)
        log = changed(recording(), 1, rows, 0.02)
        if refused:
            with pytest.raises(DataError, match="telescope .*: nothing plausible leads to"):
                usable(log)
        else:
            assert set(left_out(log)) <= set(rows.tolist())
            assert len(left_out(log)) > 0.9 * len(rows)


def test_pressures_may_jump_but_not_there_and_back() -> None:
    log = recording()
    assert log.pressure_a is not None
    value = log.pressure_a.value.copy()
    value[5000, 0] += 20e6
    value[[0, 7000], 0] += 1.5e6  # as a hammer of the oil does
    log = usable(replace(log, pressure_a=replace(log.pressure_a, value=value)))
    assert log.pressure_a is not None
    assert np.argwhere(np.isnan(log.pressure_a.value)).tolist() == [[5000, 0]]
    assert "pressure a of boom (/cylinder_pressures): 1 sample left out" in log.warnings[0]


def test_a_coarse_pressure_that_changes_little_has_no_bad_samples() -> None:
    log = recording()
    assert log.pressure_a is not None
    noise = 2e5 * np.random.default_rng(1).normal(size=log.pressure_a.value.shape)
    coarse = 1e6 * np.round((3.5e6 + 0.8e6 * np.sin(log.pressure_a.time)[:, None] + noise) / 1e6)
    assert usable(replace(log, pressure_a=replace(log.pressure_a, value=coarse))).notes == ()


def test_samples_without_a_number_are_counted() -> None:
    log = usable(changed(recording(), 0, [5, 6, 700], np.nan))
    assert log.warnings == ("bag: position of boom (/joint_states): 3 samples without a number.",)


def test_the_part_between_two_times_keeps_its_clock() -> None:
    log = usable(recording(), 10.0, 20.0)
    assert log.pressure_a is not None
    for signal in (log.position, log.pressure_a):
        assert 10.0 <= signal.time[0] < 10.01
        assert 19.99 < signal.time[-1] <= 20.0
        assert len(signal.value) == len(signal.time)
    assert log.start == 0
    for begin, end in ((61.0, np.inf), (5.0, 4.0)):
        with pytest.raises(
            DataError, match=r"bag: no position from .* it lasts 60 s: correct --fr"
        ):
            usable(recording(), begin, end)


def swing(time: np.ndarray) -> np.ndarray:
    """A joint that passes from one order of magnitude of its readings to the next."""
    return 1.6 * np.sin(0.9 * time) + 0.3 * np.sin(2.7 * time + 0.4)


def of_one(time: np.ndarray, position: np.ndarray, origin: str = "column q, tau") -> Log:
    position = position[:, np.newaxis]
    signal = Signal(time, position, origin, columns=("column q",))
    return Log("table", ("boom",), 0, signal, force=Signal(time, 10.0 * position, "column tau"))


def five_digits(seed: int) -> Log:
    """At 5 kHz, between two samples less than one step of the numbers above 1 passes."""
    time = np.arange(0.0, 8.0, 2e-4)
    return of_one(time, np.array([float(f"{sample:.5g}") for sample in swing(time)]))


def sent_again(seed: int) -> Log:
    """At 1 kHz a state in ten is sent twice, and stamps are off by 0.3 ms."""
    rng = np.random.default_rng(seed)
    row = np.arange(8000)
    row -= rng.uniform(size=len(row)) < 0.1
    row[0] = 0
    time = np.sort(np.arange(len(row)) / 1e3 + rng.uniform(-3e-4, 3e-4, len(row)))
    return of_one(time, swing(row / 1e3))


def ringing(seed: int) -> Log:
    """Smooth motion, with a vibration of 90 Hz that blows set off, and fades."""
    time = np.arange(0.0, 8.0, 1e-3)
    since = time - 4.0
    rings = np.where(since > 0, 2e-4 * np.exp(-8 * since) * np.sin(2 * np.pi * 90 * since), 0.0)
    return of_one(time, 0.1 * swing(time) + rings)


@pytest.mark.parametrize("made", [five_digits, ringing])
def test_digits_and_vibrations_are_what_they_are(made: Callable[[int], Log]) -> None:
    for seed in range(3):
        assert usable(made(seed)).notes == ()


@pytest.mark.parametrize("made", [five_digits, sent_again, ringing])
def test_a_bad_sample_among_them_is_still_found(made: Callable[[int], Log]) -> None:
    assert {*left_out(changed(made(0), 0, 5000, 0.05), 0)} - {*left_out(made(0), 0)} == {5000}


@pytest.mark.parametrize("seed", range(3))
def test_states_that_were_sent_again_are_left_out(seed: int) -> None:
    """But for the few at standstill; positions and forces alike."""
    log = sent_again(seed)
    assert log.force is not None
    jitter, note = (cleaned := usable(log)).notes
    assert jitter.startswith("column q, tau: stamps are off by 0.17 ms")
    again = np.flatnonzero(np.diff(log.position.value[:, 0], prepend=np.nan) == 0.0)
    left = left_out(log, 0)
    assert {*left} <= {*again.tolist()} and len(left) > 0.97 * len(again)
    assert note == f"column q, tau: {len(left)} states that were sent again are left out"
    assert cleaned.force is not None
    np.testing.assert_array_equal(np.isnan(cleaned.force.value), np.isnan(cleaned.position.value))


def test_a_reading_that_stays_beside_new_forces_is_no_state_sent_again() -> None:
    log = sent_again(0)
    assert log.force is not None
    noise = np.random.default_rng(1).normal(size=log.force.value.shape)
    measured = replace(log.force, value=log.force.value + noise)
    (jitter,) = usable(replace(log, force=measured)).notes
    assert "stamps are off" in jitter


def held(log: Log, rows: np.ndarray) -> Log:
    """Positions of the first of both joints; each of `rows` repeats the one before."""
    value = log.position.value[np.maximum.accumulate(np.where(rows, 0, np.arange(len(rows))))]
    return replace(log, position=replace(log.position, value=value))


def test_what_is_no_habit_of_the_sender_stays() -> None:
    """A sensor of a third of the rate, and a joint that repeats beside one that does not."""
    log = sent_again(0)
    smooth = of_one(log.position.time, swing(log.position.time))
    row = np.arange(len(log.position.time))
    assert usable(held(smooth, row % 3 > 0)).notes == ()
    beside = np.column_stack([log.position.value, swing(log.position.time + 1.0)])
    both = replace(
        log,
        joints=("boom", "stick"),
        position=Signal(smooth.position.time, beside, "q"),
        force=None,
    )
    assert usable(both).notes == ()


def test_the_column_that_is_wrong_is_named_alone() -> None:
    (note,) = usable(changed(ringing(0), 0, 5000, 0.05)).notes
    assert note.startswith("position of boom (column q): 1 sample left out")
