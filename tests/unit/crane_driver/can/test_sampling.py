"""The instant of sampling behind receptions that jitter: against a known clock of the device."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from crane_driver import constants
from crane_driver.can.stream import SamplingClock

CYCLE = 0.005  # s
BEGIN = 100.0  # s


def device(count: int, drift: float = 0.0) -> np.ndarray:
    return BEGIN + CYCLE * (1 + drift) * np.arange(count)


def receptions(sampled: np.ndarray, seed: int) -> np.ndarray:
    """Usually a little late, at times by several cycles; in order, as frames of one bus are."""
    rng = np.random.default_rng(seed)
    late = rng.exponential(5e-4, len(sampled))
    held_up = rng.random(len(sampled)) < 0.005
    late[held_up] += rng.uniform(0, 6 * CYCLE, np.count_nonzero(held_up))
    return np.maximum.accumulate(sampled + late)


def told(clock: SamplingClock, received: np.ndarray, first: int = 0) -> np.ndarray:
    return np.array([clock.sampled(k, at) for k, at in enumerate(received.tolist(), first)])


@pytest.mark.parametrize("drift", [0.0, 1e-4, -0.02], ids=["none", "crystal", "software timer"])
def test_jitter_of_milliseconds_becomes_one_of_microseconds(drift: float) -> None:
    sampled = device(6000, drift)
    received = receptions(sampled, 1)
    assert (received - sampled).std() > 1e-3
    known = sampled > BEGIN + 2 * constants.CLOCK_KNOWN_S
    error = (told(SamplingClock(CYCLE), received) - sampled)[known]
    assert np.abs(error).max() < 2e-4
    assert error.std() < 2e-5


def test_cycles_that_were_lost_change_nothing() -> None:
    sampled = device(4000)
    received = receptions(sampled, 2)
    came = np.random.default_rng(3).random(len(sampled)) > 0.05
    clock = SamplingClock(CYCLE)
    for number in np.flatnonzero(came).tolist():
        at = clock.sampled(number, float(received[number]))
        if sampled[number] > BEGIN + 2 * constants.CLOCK_KNOWN_S:
            assert at == pytest.approx(sampled[number], abs=2e-4)


def test_until_it_is_known_receptions_are_passed_on() -> None:
    received = receptions(device(round(constants.CLOCK_KNOWN_S / CYCLE)), 4)
    np.testing.assert_array_equal(told(SamplingClock(CYCLE), received), received)


def test_a_device_that_was_held_up_is_followed_anew() -> None:
    """It sampled nothing for some cycles, and did not count them."""
    before, after = device(3000), device(2000) + 3000 * CYCLE + 8 * CYCLE
    clock = SamplingClock(CYCLE)
    told(clock, receptions(before, 5))
    late = told(clock, receptions(after, 6), 3000)
    known = after > after[0] + constants.PROMPT_TIMEOUT_S + 2 * constants.CLOCK_KNOWN_S
    assert np.abs((late - after)[known]).max() < 2e-4


@given(
    st.lists(st.floats(0, 0.1), min_size=2, max_size=400),
    st.lists(st.integers(1, 3), min_size=400, max_size=400),
)
def test_whatever_comes_it_is_not_later_than_received_and_in_order(
    intervals: list[float], steps: list[int]
) -> None:
    clock = SamplingClock(CYCLE)
    received, number, last = BEGIN, 0, -np.inf
    for interval, step in zip(intervals, steps, strict=False):
        received, number = received + interval, number + step
        at = clock.sampled(number, received)
        assert last <= at <= received
        last = at
