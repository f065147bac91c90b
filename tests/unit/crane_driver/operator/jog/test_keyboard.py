"""Keys as a terminal gives them: characters, and repeats after a delay."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from crane_driver.operator.jog.jog_input import (
    FIRST_SPEED,
    JOINT_KEYS,
    REQUESTS,
    SPEED_KEYS,
    Demand,
    Keyboard,
    Request,
)

HOLD = 0.12
JOINTS = ("slew", "inner_boom", "outer_boom", "telescope")
KEYS = {
    key: (joint, direction)
    for joint, pair in zip(JOINTS, JOINT_KEYS, strict=False)
    for key, direction in zip(pair, (-1, 1), strict=True)
}
RAISED = Demand("inner_boom", FIRST_SPEED / 10)


def held(keyboard: Keyboard, start: float, end: float) -> float:
    """Seconds of motion between two times, sampled every millisecond."""
    count = round((end - start) * 1000)
    return sum(keyboard.demand(start + n * 1e-3) is not None for n in range(count)) * 1e-3


def test_a_tap_is_a_nudge_of_the_length_of_a_hold() -> None:
    keyboard = Keyboard(HOLD, JOINTS)
    keyboard.typed("k", 10.0)
    assert keyboard.demand(10.0) == RAISED
    assert held(keyboard, 10.0, 12.0) == pytest.approx(HOLD, abs=2e-3)


@pytest.mark.parametrize("delay", [0.25, 0.5, 0.66])
@pytest.mark.parametrize("interval", [1 / 30, 1 / 10.9], ids=["X11", "Linux console"])
def test_a_held_key_moves_on_while_repeats_come_and_stops_a_hold_after_the_last(
    delay: float, interval: float
) -> None:
    keyboard = Keyboard(HOLD, JOINTS)
    keyboard.typed("k", 0.0)
    moved = held(keyboard, 0.0, delay)
    for number in range(20):
        now = delay + number * interval
        keyboard.typed("k", now)
        assert held(keyboard, now, now + interval) == pytest.approx(interval, abs=2e-3)
    assert moved == pytest.approx(HOLD, abs=2e-3)
    assert keyboard.demand(now + 0.99 * HOLD) == RAISED
    assert keyboard.demand(now + HOLD) is None


@given(st.text(min_size=1, max_size=6), st.floats(0.0, HOLD))
def test_only_a_joints_key_alone_holds_a_joint(text: str, later: float) -> None:
    keyboard = Keyboard(HOLD, JOINTS)
    keyboard.typed("k", 0.0)
    keyboard.typed(text, 0.0)
    demand = keyboard.demand(later)
    if set(text) <= KEYS.keys() and len(set(text)) == 1 and later < HOLD:
        joint, direction = KEYS[text[0]]
        assert demand
        assert demand.joint == joint
        assert math.copysign(1, demand.level) == direction
    else:
        assert demand is None


@pytest.mark.parametrize("text", [" ", "\x1b[A", "kj", "hello", "å", "e", "5", "K"])
def test_everything_else_lets_go_at_once(text: str) -> None:
    keyboard = Keyboard(HOLD, JOINTS)
    keyboard.typed("k", 0.0)
    keyboard.typed(text, 0.01)
    assert keyboard.demand(0.01) is None


def test_speed_is_chosen_in_tenths() -> None:
    keyboard = Keyboard(HOLD, JOINTS)
    keyboard.typed("9", 0.0)
    keyboard.typed("j", 0.0)
    assert keyboard.demand(0.0) == Demand("inner_boom", -0.9)


def test_requests_and_that_an_emergency_stop_is_heard_among_other_keys() -> None:
    keyboard = Keyboard(HOLD, JOINTS)
    assert {key: keyboard.typed(key, 0.0) for key in REQUESTS} == REQUESTS
    assert keyboard.typed("kkxk", 0.0) is Request.EMERGENCY_STOP
    assert keyboard.typed("\x1b[A\x1b[Ax", 0.0) is Request.EMERGENCY_STOP, "an arrow was held"
    assert keyboard.typed("ke", 0.0) is None, "nothing else is"
    assert keyboard.typed("eee", 0.0) is Request.ENABLE  # a held key


def test_every_key_means_one_thing() -> None:
    keys = [*(key for pair in JOINT_KEYS for key in pair), *REQUESTS, *SPEED_KEYS]
    assert len(keys) == len(set(keys))


def test_keys_go_to_the_joints_of_any_machine_in_order() -> None:
    keyboard = Keyboard(HOLD, ("swing", "boom"))
    keyboard.typed("l", 0.0)
    assert keyboard.demand(0.0) == Demand("swing", FIRST_SPEED / 10)
    keyboard.typed("j", 0.0)
    assert keyboard.demand(0.0) == Demand("boom", -FIRST_SPEED / 10)
    keyboard.typed("i", 0.0)
    assert keyboard.demand(0.0) is None
    many = Keyboard(HOLD, [f"joint_{i}" for i in range(20)])
    assert len(many.pairs) == len(JOINT_KEYS)  # the others have a joystick
