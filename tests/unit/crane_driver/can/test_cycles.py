"""Sets of readings by counters, on buses that lose, delay and exchange frames."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from unit.crane_driver.can.traffic import (
    BUSES,
    CRANE,
    CYCLE,
    JOINTS,
    Bus,
    Sent,
    put_together,
    readings,
)

from crane_driver.can.assembly import Assembly
from crane_driver.can.cycles import LEARNT


@given(st.sampled_from(sorted(BUSES)), st.integers(0, 2**31))
@settings(max_examples=40, deadline=None, derandomize=True)
def test_whatever_goes_wrong_sets_are_of_one_cycle_and_stamps_increase(
    name: str, seed: int
) -> None:
    """One thing at a time: several at once can still mix a set now and then."""
    outcome = put_together(BUSES[name].frames(np.random.default_rng(seed), 600))
    assert (outcome.mixed, outcome.stepping_back, outcome.early) == (0, 0, 0)
    assert outcome.sets <= outcome.whole


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
    frames = BUSES["good"].frames(np.random.default_rng(5), LEARNT + 5)
    made = [len(assembly.add(readings(one))) for one in frames]
    assert made.index(LEARNT) == 2 * LEARNT - 1
    assert sum(made) == LEARNT + 5


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
    assert assembly.incomplete > 400


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


def test_after_a_silence_the_counters_are_learnt_anew() -> None:
    """A restart: the counters begin at other values, and their difference is another."""
    assembly, cycles = Assembly(CRANE, "positions"), 2 * LEARNT
    for begin, ahead in ((0.0, 3), (2.0, 9), (4.0, 0)):
        sets = []
        for cycle in range(cycles):
            at = begin + cycle * CYCLE
            sets += assembly.add(readings(Sent(at, "EncoderBase", cycle, cycle % 15, at)))
            counter = (cycle + ahead) % 15
            sets += assembly.add(readings(Sent(at + 1e-4, "EncoderBoom", cycle, counter, at)))
        assert len(sets) >= cycles - 1
        assert all(len(set(one.values.values())) == 1 for one in sets)
