"""Sets of readings: never of two cycles, never with a value that is no measurement."""

import math
from itertools import pairwise
from typing import NamedTuple

import pytest
from hypothesis import given
from hypothesis import strategies as st

from crane_driver.can.assembly import Assembly, Complete
from crane_driver.can.binding import load_layout
from crane_driver.can.decoder import Readings
from crane_driver.can.layout import Layout

BASE = {"slew": 0.1, "inner_boom": 0.2}
BOOM = {"outer_boom": -0.3, "telescope": 0.4}


@pytest.fixture
def positions(crane: Layout) -> Assembly:
    return Assembly(crane, "positions")


def add(assembly: Assembly, message: str, time: float, values: dict[str, float]) -> Complete | None:
    return assembly.add(Readings(message, int(time * 1e9), time, positions=values))


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


CRANE = load_layout()
CYCLE = 0.005  # s
SURE = 5  # cycles without delay or loss, in which the counters that belong together are learnt
COUNT = 15  # values of a counter


class Sent(NamedTuple):
    """One frame on its way."""

    received: float  # s
    message: str
    cycle: int


def readings(frame: Sent, first: int) -> Readings:
    """A frame whose values all are the number of its cycle."""
    joints = BASE if frame.message == "EncoderBase" else BOOM
    return Readings(
        frame.message,
        round(frame.received * 1e9),
        frame.received,
        (first + frame.cycle) % COUNT,
        dict.fromkeys(joints, float(frame.cycle)),
    )


@st.composite
def streams(draw: st.DrawFn) -> list[Sent]:
    """Frames of both messages, each message in its order, late and with losses, in any mixture."""
    frames = [
        Sent(cycle * CYCLE, message, cycle)
        for cycle in range(SURE)
        for message in ("EncoderBase", "EncoderBoom")
    ]
    fates = draw(st.lists(st.tuples(*[st.integers(-1, 20)] * 2), min_size=1, max_size=40))
    for column, message in enumerate(("EncoderBase", "EncoderBoom")):
        received, lost = 0.0, 0
        for cycle, fate in enumerate(fates, SURE):
            delay = fate[column]  # ms; -1: lost
            lost = lost + 1 if delay < 0 else 0
            if 0 < lost <= CRANE.timing.lost:
                continue
            received = max(received + 1e-5, cycle * CYCLE + max(delay, 0) * 1e-3)
            frames.append(Sent(received, message, cycle))
            lost = 0
    return sorted(frames)


@given(streams(), st.integers(0, COUNT - 1), st.integers(0, COUNT - 1))
def test_whatever_the_delays_sets_are_of_one_cycle_and_none_is_left_out(
    frames: list[Sent], base: int, boom: int
) -> None:
    positions = Assembly(CRANE, "positions")
    first = {"EncoderBase": base, "EncoderBoom": boom}
    complete = [positions.add(readings(one, first[one.message])) for one in frames]
    sets = [one for one in complete if one]
    cycles = [one.values["slew"] for one in sets]
    assert all(len(set(one.values.values())) == 1 for one in sets), "mixed"
    assert cycles == sorted(set(cycles)), "in their order, none twice"

    came: dict[int, list[float]] = {}
    for frame in frames:
        came.setdefault(frame.cycle, []).append(frame.received)
    whole = {cycle: max(times) for cycle, times in came.items() if len(times) == 2}
    expected = [
        cycle
        for cycle, at in whole.items()
        if not any(later > cycle and before < at for later, before in whole.items())
    ]
    assert cycles == expected
    assert [one.received for one in sets] == [min(came[cycle]) for cycle in expected]


def test_counters_that_never_agree_leave_the_time_rule(positions: Assembly) -> None:
    """A device whose messages count irregularly: as if they had no counters."""
    for cycle in range(30):
        at = cycle * CYCLE
        positions.add(readings(Sent(at, "EncoderBase", cycle), 0))
        assert positions.add(readings(Sent(at + 1e-4, "EncoderBoom", 2 * cycle), 0))
    positions.add(readings(Sent(0.15, "EncoderBase", 30), 0))
    assert positions.add(readings(Sent(0.153, "EncoderBoom", 60), 0)) is None


@pytest.mark.parametrize("drift", [-0.01, 0.01])
def test_devices_whose_clocks_drift_apart_go_on_making_sets(
    drift: float, positions: Assembly
) -> None:
    """Two encoders by themselves: one falls behind the other, whole cycles in the end."""
    rates = {"EncoderBase": 1.0, "EncoderBoom": 1.0 + drift}
    frames = sorted(
        Sent(cycle * CYCLE * rate, message, cycle)
        for cycle in range(2000)
        for message, rate in rates.items()
    )
    complete = [frame.received for frame in frames if positions.add(readings(frame, 0))]
    assert max(after - before for before, after in pairwise(complete)) < 3 * CYCLE


def test_after_a_silence_the_counters_are_learnt_anew(positions: Assembly) -> None:
    """A restart: the counters begin at other values, and their difference is another."""
    for begin, boom in ((0.0, 3), (1.0, 9), (2.0, 0)):
        sets = 0
        for cycle in range(30):
            late = 0.004 if cycle > SURE else 0.0
            sets += bool(
                positions.add(readings(Sent(begin + cycle * CYCLE, "EncoderBase", cycle), 0))
            )
            at = begin + cycle * CYCLE + late
            sets += bool(positions.add(readings(Sent(at, "EncoderBoom", cycle), boom)))
        assert sets == 30
    assert positions.incomplete == 0
