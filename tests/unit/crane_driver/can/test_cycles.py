"""Sets of readings by counters, on buses that lose, delay and exchange frames."""

from collections.abc import Callable
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from unit.crane_driver.can.traffic import (
    BEGIN,
    BUSES,
    COUNT,
    CRANE,
    CYCLE,
    JOINTS,
    Bus,
    Sent,
    any_bus,
    put_together,
    readings,
)

from crane_driver import constants
from crane_driver.can.assembly import Assembly


@given(st.sampled_from(sorted(BUSES)), st.integers(0, 2**31))
@settings(max_examples=20, deadline=None, derandomize=True)
def test_whatever_goes_wrong_sets_are_of_one_cycle_and_stamps_increase(
    name: str, seed: int
) -> None:
    outcome = put_together(BUSES[name].frames(np.random.default_rng(seed), 600))
    assert (outcome.mixed, outcome.stepping_back, outcome.early) == (0, 0, 0)
    assert outcome.sets <= outcome.whole


# The last ones mixed sets while indices were guessed, or the first one of an epoch was.
@pytest.mark.parametrize("seed", [*range(10), 155, 518, 711, 928, 980, 995, 1065, 1275, 41101])
def test_several_troubles_at_once_mix_no_set(seed: int) -> None:
    rng = np.random.default_rng(seed)
    outcome = put_together(any_bus(rng).frames(rng, 600))
    assert (outcome.mixed, outcome.stepping_back, outcome.early) == (0, 0, 0)


@pytest.mark.parametrize(("name", "share"), [("good", 1.0), ("lossy", 0.98), ("late", 0.9)])
def test_what_came_whole_is_put_together(name: str, share: float) -> None:
    """A bus keeps the order of the frames of a device."""
    outcome = put_together(BUSES[name].frames(np.random.default_rng(3), 2000))
    assert share * outcome.whole <= outcome.sets <= outcome.whole


def test_a_train_of_frames_that_is_held_up_is_put_together() -> None:
    """As by a host that stands still for a moment: 20 ms on average, five times a second."""
    outcome = put_together(Bus(held_up=0.025).frames(np.random.default_rng(7), 4000))
    assert outcome.sets >= 0.97 * outcome.whole


def test_what_is_not_put_together_is_counted() -> None:
    frames = BUSES["lossy"].frames(np.random.default_rng(4), 2000)
    outcome = put_together(frames)
    began = len({frame.cycle for frame in frames})
    assert outcome.sets + outcome.incomplete == pytest.approx(began, abs=3)


def test_frames_wait_until_it_is_known_which_belong_together() -> None:
    """None is lost: the sets of the time before come when it is over."""
    assembly = Assembly(CRANE, "positions")
    frames = BUSES["good"].frames(np.random.default_rng(5), constants.LEARNING_FRAMES + 5)
    made = [len(assembly.add(readings(one))) for one in frames]
    assert made.index(constants.LEARNING_FRAMES) == 2 * constants.LEARNING_FRAMES - 1
    assert sum(made) == constants.LEARNING_FRAMES + 5


def test_a_message_that_does_not_come_does_not_fill_the_memory() -> None:
    assembly = Assembly(CRANE, "positions")
    for cycle in range(3000):
        at = 1.0 + cycle * CYCLE
        assert not assembly.add(readings(Sent(at, "EncoderBase", cycle, cycle % 15, at)))
    assert assembly.incomplete == 2000


def test_a_counter_that_does_not_count_makes_no_sets() -> None:
    rng = np.random.default_rng(6)
    frames = BUSES["good"].frames(rng, 500)
    irregular = [
        one._replace(counter=int(rng.integers(15))) if one.message == "EncoderBoom" else one
        for one in frames
    ]
    assembly = Assembly(CRANE, "positions")
    assert not any(assembly.add(readings(one)) for one in irregular)
    assert not assembly.finish()
    assert assembly.incomplete == 500


@pytest.mark.parametrize("drift", [-0.001, 0.001])
def test_devices_whose_clocks_drift_apart_go_on_making_sets(drift: float) -> None:
    """Two encoders by themselves: one falls behind the other, whole cycles in the end."""
    rates = {"EncoderBase": 1.0, "EncoderBoom": 1.0 + drift}
    frames = sorted(
        Sent(cycle * CYCLE * rates[message], message, cycle, cycle % 15, cycle * CYCLE)
        for cycle in range(8000)
        for message in JOINTS
    )
    assembly = Assembly(CRANE, "positions")
    sets = [one for frame in frames for one in assembly.add(readings(frame))]
    assert max(b.received - a.received for a, b in pairwise(sets)) < 3 * CYCLE
    base, boom = (np.array([one.values[joint] for one in sets]) for joint in ("slew", "telescope"))
    assert np.abs(base - (1.0 + drift) * boom).max() < 1.0  # cycles between their samplings


@pytest.mark.parametrize("slower", [-0.15, -0.01, 0.01, 0.1])
def test_devices_that_send_by_another_cycle_time_than_stated_make_sets(slower: float) -> None:
    frames = BUSES["good"].frames(np.random.default_rng(9), 3000)
    stretched = [
        one._replace(received=one.received + slower * (one.sampled - BEGIN)) for one in frames
    ]
    outcome = put_together(sorted(stretched))
    assert outcome.mixed == 0
    assert outcome.sets >= 0.99 * outcome.whole


@pytest.mark.parametrize("seed", range(20))
@pytest.mark.parametrize("delay", [0.5e-3, 1e-3, 2e-3])
def test_delays_that_come_and_go_are_no_cycle_time(delay: float, seed: int) -> None:
    """One of the messages seemed to have another cycle time than the other: no set, for ever."""
    rng = np.random.default_rng(seed)
    frames, late = [], 0.0
    for cycle in range(2000):
        sampled, late = BEGIN + cycle * CYCLE, 0.98 * late + rng.normal(0.0, 0.2 * delay)
        for message, part in zip(JOINTS, (0.6, 1.0), strict=True):
            received = sampled + 2e-4 + part * abs(late)
            frames.append(Sent(received, message, cycle, cycle % COUNT, sampled))
    outcome = put_together(sorted(frames))
    assert outcome.mixed == 0
    assert outcome.sets >= 0.9 * outcome.whole


def test_few_frames_tell_no_cycle_time() -> None:
    for cycles in (1, 2, 5):
        assembly = Assembly(CRANE, "positions")
        frames = BUSES["good"].frames(np.random.default_rng(2), cycles)
        assert not any(assembly.add(readings(one)) for one in frames)
        assembly.finish()  # whatever they show, it does not fail


def test_after_a_silence_the_counters_are_learnt_anew() -> None:
    """A restart: the counters begin at other values, and their difference is another."""
    assembly, cycles = Assembly(CRANE, "positions"), 2 * constants.LEARNING_FRAMES
    for begin, ahead in ((0.0, 3), (2.0, 9), (4.0, 0)):
        sets = []
        for cycle in range(cycles):
            at = begin + cycle * CYCLE
            sets += assembly.add(readings(Sent(at, "EncoderBase", cycle, cycle % 15, at)))
            counter = (cycle + ahead) % 15
            sets += assembly.add(readings(Sent(at + 1e-4, "EncoderBoom", cycle, counter, at)))
        assert len(sets) >= cycles - 1
        assert all(len(set(one.values.values())) == 1 for one in sets)


def even(cycles: int, boom: Callable[[int], Sent | None]) -> list[Sent]:
    """Prompt frames of the base; those of the boom as the test has them."""
    base = (Sent(at(k), "EncoderBase", k, k % COUNT, at(k)) for k in range(cycles))
    return sorted([*base, *(one for k in range(cycles) if (one := boom(k)))])


def at(cycle: float) -> float:
    return BEGIN + cycle * CYCLE


def late(cycle: int, by: float, ahead: int = 0) -> Sent:
    """A frame of the boom, late by so many cycles, its counter ahead of the base's."""
    return Sent(at(cycle + by), "EncoderBoom", cycle, (cycle + ahead) % COUNT, at(cycle))


def seen(frames: list[Sent]) -> list[tuple[float, str, int]]:
    """What a driver knows of them."""
    return [(round(one.received, 6), one.message, one.counter) for one in frames]


@pytest.mark.parametrize(("by", "sets"), [(11.4, 200), (14.6, 196), (16.4, 193)])
def test_of_a_train_held_up_for_a_round_a_few_frames_are_left_out(by: float, sets: int) -> None:
    """They may be of another round if others are lost: the first, and those that come after the
    train within the time in which frames may overtake each other.
    """
    train = even(200, lambda k: late(k, max(100 + by - k, 0.0) if k >= 100 else 0.0))
    outcome = put_together(train)
    assert (outcome.mixed, outcome.sets) == (0, sets)
    gaps = [one for one in train if one.message == "EncoderBase" or not 100 < one.cycle < 114]
    assert put_together(gaps).mixed == 0


def test_a_message_late_by_whole_cycles_from_the_first_frame_cannot_be_told_from_a_prompt_one() -> (
    None
):
    """No driver could: frames and times are the same, and a prompt message makes whole sets."""
    delayed = even(200, lambda cycle: late(cycle, 2.0) if cycle < 198 else None)
    prompt = even(200, lambda cycle: late(cycle, 0.0, ahead=-2) if cycle > 1 else None)
    assert seen(delayed) == seen(prompt)
    assert put_together(prompt).mixed == 0
    assert put_together(delayed).mixed == put_together(prompt).sets > 100


def test_a_frame_overtaken_by_a_round_cannot_be_told_from_the_one_a_round_later() -> None:
    """Within 3 cycles frames may overtake each other."""
    overtaken = even(
        200, lambda k: None if k == 115 else late(k, 15.0) if k == 100 else late(k, 0.0)
    )
    lost = even(200, lambda k: None if k == 100 else late(k, 0.0))
    assert seen(overtaken) == seen(lost)
    assert put_together(lost).mixed == 0
    assert put_together(overtaken).mixed == 1
    shortly = even(200, lambda k: late(k, 2.9) if k == 100 else late(k, 0.0))
    assert put_together(shortly).mixed == 0


@pytest.mark.parametrize("silent", [5, 10, 19, 21])
@pytest.mark.parametrize("ahead", range(1, COUNT))
def test_a_device_that_restarts_after_a_silence_makes_no_mixed_set(silent: int, ahead: int) -> None:
    def boom(cycle: int) -> Sent | None:
        if 100 <= cycle < 100 + silent:
            return None
        return late(cycle, 0.0, ahead if cycle >= 100 else 0)

    outcome = put_together(even(300, boom))
    assert outcome.mixed == 0
    assert outcome.sets > 240


def test_a_restart_without_silence_cannot_be_told_from_frames_that_are_late_from_then_on() -> None:
    """Until none has been prompt for 200 frames."""
    restarted = even(
        300, lambda k: late(k, 0.0, -2 if k >= 102 else 0) if k not in (100, 101) else None
    )
    delayed = even(300, lambda k: late(k, 0.0) if k < 100 else late(k, 2.0) if k < 298 else None)
    assert seen(restarted) == seen(delayed)
    assert put_together(delayed).mixed == 0
    assert 100 < put_together(restarted).mixed <= 200
