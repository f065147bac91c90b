"""Two streams in any interleaving give the same matches."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from crane_identification.online.streams import CAPACITY, Matched, Matcher

GAP = 25_000_000
STEP = 5_000_000


def reading(value: float) -> np.ndarray:
    return np.array([value])


def matched(matcher: Matcher, order: list[bool], shift: int, count: int) -> list[Matched]:
    """Positions k at k steps, pressures 10 k at k steps + shift; `order` says who comes first."""
    out: list[Matched] = []
    position = pressure = 0
    for first in [*order, *[True, False] * 2 * count]:
        if first and position < count:
            out += matcher.add_position(position * STEP, reading(position))
            position += 1
        elif not first and pressure < count:
            out += matcher.add_pressure(pressure * STEP + shift, reading(10 * pressure))
            pressure += 1
    return out


@settings(deadline=None)
@given(st.lists(st.booleans(), max_size=60), st.integers(0, STEP - 1))
def test_matches_do_not_depend_on_the_interleaving(order: list[bool], shift: int) -> None:
    count = 30
    matcher = Matcher(GAP)
    out = matched(matcher, order, shift, count)
    begin = 0 if shift == 0 else 1  # the first position has no pressure before it
    assert [m.stamp for m in out] == [k * STEP for k in range(begin, count)]
    for m in out:
        assert m.position[0] * STEP == m.stamp
        assert m.pressure[0] == pytest.approx(10 * (m.stamp - shift) / STEP)
    assert (matcher.matched, matcher.unmatched) == (len(out), begin)


def test_pressures_with_the_stamp_of_the_encoders_are_taken_as_they_are() -> None:
    matcher = Matcher(GAP)
    assert matcher.add_position(STEP, reading(1.0)) == []
    (found,) = matcher.add_pressure(STEP, reading(7.0))
    assert found.pressure[0] == 7.0


def test_nothing_is_interpolated_over_a_gap() -> None:
    matcher = Matcher(GAP)
    matcher.add_pressure(0, reading(0.0))
    for k in range(1, 10):
        matcher.add_position(k * STEP, reading(k))
    assert matcher.add_pressure(10 * STEP, reading(1.0)) == []
    assert matcher.unmatched == 9


def test_positions_without_any_pressure_are_counted_and_bounded() -> None:
    matcher = Matcher(GAP)
    for k in range(CAPACITY + 50):
        matcher.add_position(k * STEP, reading(k))
    assert matcher.unmatched == 50


def test_pressures_without_any_position_are_bounded() -> None:
    matcher = Matcher(GAP)
    for k in range(CAPACITY + 50):
        matcher.add_pressure(k * STEP, reading(k))
    matcher.add_position(10 * STEP, reading(0.0))
    assert matcher.unmatched == 1  # what it needed was dropped


def test_repeated_stamps_are_dropped() -> None:
    matcher = Matcher(GAP)
    for value in (1.0, 2.0):
        matcher.add_pressure(0, reading(value))
        matcher.add_pressure(STEP, reading(value))
    found = matcher.add_position(STEP, reading(3.0))
    assert matcher.add_position(STEP, reading(4.0)) == []
    assert [m.pressure[0] for m in found] == [1.0]
    assert matcher.repeated == 3


def test_both_clocks_may_start_anew_in_either_order() -> None:
    for first in (True, False):
        matcher = Matcher(GAP)
        for shift in (100 * STEP, 0):
            order = [first, not first] * 20
            out = []
            k = {True: 0, False: 0}
            for which in order:
                stamp = shift + k[which] * STEP
                k[which] += 1
                add = matcher.add_position if which else matcher.add_pressure
                out += add(stamp, reading(0.0))
            assert len(out) >= 19
