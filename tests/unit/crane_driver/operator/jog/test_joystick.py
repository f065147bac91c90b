"""A joystick by its messages."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from crane_driver import constants
from crane_driver.operator.jog.jog_input import Axis, Demand, Joystick

AXES = {"slew": Axis(0, 1), "inner_boom": Axis(2, -1)}
DEADMAN = 1
PRESSED, FREE = [0, 1], [0, 0]


def armed() -> Joystick:
    """The deadman button held, the axes at their centres, at time 0."""
    joystick = Joystick(DEADMAN, AXES)
    joystick.received([0.0, 0.0, 0.0], PRESSED, 0.0)
    return joystick


def test_an_axis_moves_its_joint_while_the_button_is_held() -> None:
    joystick = armed()
    joystick.received([1.0, 0.0, 0.0], PRESSED, 0.01)
    assert joystick.demand(0.01) == Demand("slew", 1.0)
    joystick.received([0.0, 0.0, 0.55], PRESSED, 0.02)
    assert joystick.demand(0.02) == ("inner_boom", pytest.approx(-0.5))
    joystick.received([0.0, 0.0, 0.55], FREE, 0.03)
    assert joystick.demand(0.03) is None


def test_the_button_counts_only_once_the_axes_were_at_their_centres() -> None:
    joystick = Joystick(DEADMAN, AXES)
    joystick.received([0.5, 0.0, 0.0], PRESSED, 0.0)
    assert joystick.demand(0.0) is None
    assert "centres" in joystick.problem
    joystick.received([0.0, 0.0, 0.0], PRESSED, 0.01)
    joystick.received([0.5, 0.0, 0.0], PRESSED, 0.02)
    assert joystick.demand(0.02)


def test_silence_lets_go_and_the_axes_have_to_be_centred_again() -> None:
    joystick = armed()
    joystick.received([1.0, 0.0, 0.0], PRESSED, 0.05)
    assert joystick.demand(0.049 + constants.JOYSTICK_SILENCE_S)
    assert joystick.demand(0.051 + constants.JOYSTICK_SILENCE_S) is None
    joystick.received([1.0, 0.0, 0.0], PRESSED, 0.2)
    assert joystick.demand(0.2) is None


def test_silence_counts_even_if_nobody_asked_during_it() -> None:
    joystick = armed()
    joystick.received([1.0, 0.0, 0.0], PRESSED, constants.JOYSTICK_SILENCE_S + 0.01)
    assert joystick.demand(constants.JOYSTICK_SILENCE_S + 0.01) is None


def test_one_joint_moves_until_its_axis_is_back() -> None:
    joystick = armed()
    joystick.received([0.4, 0.0, 0.2], PRESSED, 0.01)
    joystick.received([0.3, 0.0, -1.0], PRESSED, 0.02)
    demand = joystick.demand(0.02)
    assert demand
    assert demand.joint == "slew"
    joystick.received([constants.CENTRE_SHARE, 0.0, -1.0], PRESSED, 0.03)
    assert joystick.demand(0.03) == Demand("inner_boom", 1.0)


@pytest.mark.parametrize(
    ("axes", "buttons", "problem"),
    [
        ([math.nan, 0.0, 0.0], PRESSED, "axis 0 of slew is nan"),
        ([0.0, 0.0, math.inf], PRESSED, "axis 2 of inner_boom is inf"),
        ([0.0], PRESSED, "no axis 2 for inner_boom on /joy, it has 1"),
        ([1.0, 0.0, 0.0], [1], "no button 1 on /joy, it has 1"),
    ],
)
def test_what_cannot_be_followed_lets_go(
    axes: list[float], buttons: list[int], problem: str
) -> None:
    joystick = armed()
    joystick.received([1.0, 0.0, 0.0], PRESSED, 0.01)
    joystick.received(axes, buttons, 0.02)
    assert joystick.demand(0.02) is None
    assert problem in joystick.problem


messages = st.lists(
    st.tuples(
        st.lists(st.floats(), min_size=2, max_size=4),
        st.lists(st.integers(0, 1), min_size=1, max_size=3),
        st.floats(0.0, 0.2),
    ),
    max_size=30,
)


@given(messages)
def test_whatever_comes_a_demand_is_finite_and_only_with_the_button(
    messages: list[tuple[list[float], list[int], float]],
) -> None:
    joystick, now = Joystick(DEADMAN, AXES), 0.0
    for axes, buttons, pause in messages:
        now += pause
        joystick.received(axes, buttons, now)
        if demand := joystick.demand(now):
            assert buttons[DEADMAN] == 1
            assert -1.0 <= demand.level <= 1.0
            assert demand.level * AXES[demand.joint].sign * axes[AXES[demand.joint].number] > 0
