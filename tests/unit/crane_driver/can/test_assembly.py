"""Sets of readings without counters: never of two cycles, never with what is no measurement."""

import math
from dataclasses import replace

import pytest

from crane_driver.can.assembly import Assembly, Complete
from crane_driver.can.codec import Readings
from crane_driver.can.layout import UNPROTECTED, Layout

BASE = {"slew": 0.1, "inner_boom": 0.2}
BOOM = {"outer_boom": -0.3, "telescope": 0.4}


@pytest.fixture
def positions(crane: Layout) -> Assembly:
    """Of a crane whose messages have no counters."""
    bare = tuple(replace(one, protection=UNPROTECTED) for one in crane.readings)
    return Assembly(replace(crane, readings=bare), "positions")


def add(assembly: Assembly, message: str, time: float, values: dict[str, float]) -> Complete | None:
    complete = assembly.add(Readings(message, int(time * 1e9), time, positions=values))
    assert len(complete) <= 1
    return complete[0] if complete else None


def test_a_set_is_complete_with_its_last_frame_and_has_the_stamp_of_its_first(
    positions: Assembly,
) -> None:
    assert add(positions, "EncoderBase", 1.0, BASE) is None
    complete = add(positions, "EncoderBoom", 1.0003, BOOM)
    assert complete == Complete(1_000_000_000, 1.0, 1.0, {**BASE, **BOOM})
    assert tuple(complete.values) == ("slew", "inner_boom", "outer_boom", "telescope")


def test_the_order_of_the_frames_does_not_matter(positions: Assembly) -> None:
    assert add(positions, "EncoderBoom", 1.0, BOOM) is None
    complete = add(positions, "EncoderBase", 1.0003, BASE)
    assert complete and complete.values == {**BASE, **BOOM}


def test_frames_of_two_cycles_are_not_mixed(positions: Assembly) -> None:
    add(positions, "EncoderBoom", 1.0, BOOM)  # its partner is lost
    assert add(positions, "EncoderBase", 1.005, BASE) is None
    complete = add(positions, "EncoderBoom", 1.0052, {"outer_boom": -0.31, "telescope": 0.41})
    assert complete and complete.values["outer_boom"] == -0.31
    assert positions.incomplete == 1


def test_a_frame_that_comes_twice_begins_a_new_set(positions: Assembly) -> None:
    add(positions, "EncoderBase", 1.0, BASE)
    add(positions, "EncoderBase", 1.002, {"slew": 0.5, "inner_boom": 0.6})
    complete = add(positions, "EncoderBoom", 1.003, BOOM)
    assert complete and complete.values["slew"] == 0.5
    assert positions.incomplete == 1


def test_a_value_that_is_no_measurement_is_nan(positions: Assembly) -> None:
    add(positions, "EncoderBase", 1.0, {"slew": 0.1})
    complete = add(positions, "EncoderBoom", 1.0001, BOOM)
    assert complete and math.isnan(complete.values["inner_boom"])


def test_other_messages_do_not_matter(positions: Assembly) -> None:
    add(positions, "EncoderBase", 1.0, BASE)
    assert add(positions, "ValveStatus", 1.0001, {}) is None
    assert add(positions, "EncoderBoom", 1.0002, BOOM)


def test_a_frame_that_seems_to_come_before_the_last_set_makes_none(positions: Assembly) -> None:
    add(positions, "EncoderBase", 1.0, BASE)
    assert add(positions, "EncoderBoom", 1.0001, BOOM)
    add(positions, "EncoderBase", 1.0, BASE)
    assert add(positions, "EncoderBoom", 1.0, BOOM) is None
    assert positions.incomplete == 1


@pytest.mark.parametrize("back", [0.2, 3600.0])
def test_a_wall_clock_that_is_set_back_does_not_end_the_readings(
    back: float, positions: Assembly
) -> None:
    add(positions, "EncoderBase", 1000.0, BASE)
    add(positions, "EncoderBoom", 1000.0, BOOM)
    stamp = round((1000.005 - back) * 1e9)
    for message, joints in (("EncoderBase", BASE), ("EncoderBoom", BOOM)):
        complete = positions.add(Readings(message, stamp, 1000.005, positions=joints))
    assert [one.stamp for one in complete] == [stamp]
