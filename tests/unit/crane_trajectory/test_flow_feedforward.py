"""The controllers that use the model: what they reach, and that each failure ends well."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from unit.crane_trajectory.one_joint import (
    DT,
    JOINT,
    MACHINE,
    PERIOD,
    Boom,
    Course,
    hydraulics,
    model,
    swing,
)

from crane_trajectory.control.controller import (
    STOP_RATE,
    ControlCondition,
    Point,
    SensorReading,
    Wanted,
    gravest,
)
from crane_trajectory.control.flow_feedforward import FlowFeedforward, feedback_gains
from crane_trajectory.control.valves_and_oil import USED_AGAIN, ValvesAndOil

GOOD = 2e-4  # rad, an error of a swing of 0.3 rad
DEAD_BAND = 0.06
LARGEST_JUMP = 0.02
"""Of the command of a transition, beyond what crosses the dead band."""


def controller(
    known: ValvesAndOil | None = None, scale: float = 1.0, **given: bool
) -> FlowFeedforward:
    """Of the boom, begun at rest."""
    gains = feedback_gains(MACHINE, model(), scale)
    made = FlowFeedforward(MACHINE, model(), known or hydraulics(), gains, **given)
    made.start(np.zeros(1))
    return made


def jump(course: Course, begin: float, end: float) -> float:
    """Largest change of the opening from cycle to cycle: of the command beyond its dead band."""
    inside = (course.time >= begin) & (course.time < end)
    u = course.command[inside]
    opening = np.sign(u) * np.maximum(np.abs(u) - DEAD_BAND, 0.0)
    return float(np.abs(np.diff(opening)).max())


@pytest.mark.parametrize("pressures", [True, False])
def test_follows_with_and_without_pressures(pressures: bool) -> None:
    course = Boom(controller(pressures=pressures)).run(2 * PERIOD)
    assert course.rms() < GOOD
    assert course.had(0.1, 2 * PERIOD) == {ControlCondition.FOLLOWING}
    assert course.had(-0.2, -0.1) == {ControlCondition.AT_REST}


def test_computed_force_follows_too() -> None:
    assert Boom(controller(by_force=True)).run(2 * PERIOD).rms() < 5 * GOOD


@pytest.mark.parametrize("pressures", [True, False])
def test_is_stable_at_twice_the_gains_and_50_ms_late(pressures: bool) -> None:
    told = Boom(controller(scale=2.0, pressures=pressures), delay=0.05 + 0.015).run(3 * PERIOD)
    assert told.rms(2 * PERIOD) < 10 * GOOD
    assert told.rms(2 * PERIOD) < 1.1 * told.rms(PERIOD, 2 * PERIOD)  # it does not grow


def test_before_start_the_valves_stay_closed() -> None:
    made = FlowFeedforward(MACHINE, model(), hydraulics())
    course = Boom(made).run(1.0)
    assert not course.command.any()
    assert course.had(-1.0, 1.0) == {ControlCondition.NOT_INITIALISED}


def test_at_rest_the_valve_is_closed() -> None:
    rest = swing(0.0)
    course = Boom(controller(), reference=lambda time: rest).run(2.0)
    assert not course.command.any()
    assert course.had(-1.0, 2.0) == {ControlCondition.AT_REST}


def test_takes_over_a_moving_joint_without_a_jump() -> None:
    made = controller()
    made.start(np.array([0.15]))
    rest = swing(0.0)
    zero = np.zeros(1)
    reading = SensorReading(zero, zero, np.array([6e6]), np.array([6e6]), 16e6)
    moving = Point(rest.position, np.array([0.05]), np.array([0.1]))
    u = made.command(DT, reading, Wanted(moving, moving))
    assert u[0] == pytest.approx(0.15, abs=LARGEST_JUMP)


FAILURES = {
    "nan": lambda p: np.array([np.nan]),
    "stuck": lambda p: np.array([6.123e6]),
    "zero": lambda p: np.array([-2e6]),
    "full scale": lambda p: np.array([4e7]),
}


@pytest.mark.parametrize("chamber", ["pressure_a", "pressure_b"])
@pytest.mark.parametrize("failure", FAILURES)
def test_a_lost_transducer_leaves_the_law_without_it(failure: str, chamber: str) -> None:
    begin, end = 1.0, 3.0

    def tamper(time: float, reading: SensorReading) -> SensorReading:
        if not begin <= time < end:
            return reading
        return reading._replace(**{chamber: FAILURES[failure](getattr(reading, chamber))})

    course = Boom(controller(), tamper=tamper).run(2 * PERIOD)
    noticed = begin + (0.25 if failure == "stuck" else DT)
    assert course.had(noticed, end) == {ControlCondition.PRESSURES_LOST}
    assert course.had(end + USED_AGAIN + 0.1, 2 * PERIOD) == {ControlCondition.FOLLOWING}
    assert jump(course, begin - 0.1, end + USED_AGAIN + 0.2) < LARGEST_JUMP
    assert course.rms() < 3 * GOOD


def test_a_lost_supply_reading_leaves_that_of_the_model() -> None:
    def tamper(time: float, reading: SensorReading) -> SensorReading:
        return reading._replace(supply=np.nan) if time > 1.0 else reading

    assert Boom(controller(), tamper=tamper).run(2 * PERIOD).rms() < GOOD


def test_a_position_that_is_not_measured_closes_the_valve_for_good() -> None:
    def tamper(time: float, reading: SensorReading) -> SensorReading:
        lost = 1.0 <= time < 1.1
        return reading._replace(position=np.array([np.nan])) if lost else reading

    course = Boom(controller(), tamper=tamper).run(3.0)
    assert course.had(1.0, 3.0) == {ControlCondition.NOT_MEASURED}
    after = course.time > 1.0 - DT
    assert np.abs(np.diff(course.command[after])).max() <= STOP_RATE * DT + 1e-12
    assert not course.command[course.time > 1.3].any()


def test_a_valve_that_does_not_answer_is_closed() -> None:
    course = Boom(controller(), answers=lambda time: float(time < 0.7)).run(3.0)
    assert course.condition[-1] is ControlCondition.NO_ANSWER
    assert not course.command[course.time > 2.0].any()


def test_a_model_with_reversed_sign_ends_at_rest() -> None:
    course = Boom(controller(hydraulics(sense=-1.0))).run(3.0)
    assert course.condition[-1] is ControlCondition.WRONG_MODEL
    assert not course.command[-20:].any()
    went = [swing(t).position[0] - e for t, e in zip(course.time, course.error, strict=True)]
    assert min(went) > -0.1  # of a swing of 0.3 rad to the other side


def test_a_reference_beyond_the_valve_saturates_and_recovers() -> None:
    def fast(time: float) -> Point:
        at = swing(time)
        if not 0.5 < time < 1.0:
            return at
        return at._replace(velocity=at.velocity + 3.0)

    course = Boom(controller(), reference=fast).run(3 * PERIOD)
    assert ControlCondition.SATURATED in course.had(0.4, 1.2)
    assert course.had(PERIOD, 3 * PERIOD) == {ControlCondition.FOLLOWING}
    assert course.rms(2 * PERIOD) < 2 * GOOD


def test_at_the_largest_command_that_is_allowed_it_is_saturated_and_nothing_worse() -> None:
    allowed = 0.12

    class Held(FlowFeedforward):
        def command(self, dt: float, reading: SensorReading, wanted: Wanted) -> np.ndarray:
            return super().command(dt, reading, wanted._replace(largest=allowed))

    made = Held(MACHINE, model(), hydraulics())
    made.start(np.zeros(1))
    course = Boom(made).run(2 * PERIOD)
    assert np.abs(course.command).max() == pytest.approx(allowed)
    assert course.had(0.5, 2 * PERIOD) <= {ControlCondition.FOLLOWING, ControlCondition.SATURATED}
    assert ControlCondition.SATURATED in course.had(0.5, 2 * PERIOD)


def test_learns_dead_bands_and_gains() -> None:
    wrong = hydraulics(
        dead_band_extend=0.072, dead_band_retract=0.04, supply_a=1.2e-7, a_tank=0.8e-7
    )
    fixed, made = Boom(controller(wrong)).run(4 * PERIOD), controller(wrong, adaptive=True)
    course = Boom(made).run(4 * PERIOD)
    assert course.rms(2 * PERIOD) < 0.3 * fixed.rms(2 * PERIOD)
    learnt = made.memory.learnt[0, 0]
    c_a, c_b = learnt["gain"]
    assert learnt["dead_band"] == pytest.approx(0.06, abs=0.003)
    assert 1.2e-7 / c_a == pytest.approx(1e-7 / 0.94, rel=0.04)
    assert 1e-7 / c_b == pytest.approx(1e-7 / 0.94, rel=0.04)


def test_learned_values_are_bounded_and_reported() -> None:
    wrong = hydraulics(supply_a=5e-7, b_tank=5e-7, supply_b=5e-7, a_tank=5e-7)
    course = Boom(controller(wrong, adaptive=True)).run(3 * PERIOD)
    assert ControlCondition.ADAPTATION_AT_BOUND in course.had(0.0, 3 * PERIOD)
    assert np.isfinite(course.command).all()


def test_the_inverse_of_play_pays() -> None:
    true = hydraulics(play=0.03)
    without = Boom(controller(), true).run(2 * PERIOD).rms(PERIOD)
    inverted = Boom(controller(true), true).run(2 * PERIOD).rms(PERIOD)
    assert inverted < 0.4 * without


number = st.floats(allow_nan=True, allow_infinity=True, width=64)
sane = st.floats(-1.0, 1.0)


@settings(max_examples=60, deadline=None)
@given(
    st.lists(
        st.tuples(st.one_of(sane, number), number, number, number, number, sane, sane, sane),
        min_size=1,
        max_size=8,
    ),
    st.sampled_from([{}, {"pressures": False}, {"adaptive": True}, {"by_force": True}]),
)
def test_commands_are_finite_and_bounded_whatever_is_read(
    samples: list[tuple[float, ...]], given_: dict[str, bool]
) -> None:
    made = controller(**given_)
    for q, v, p_a, p_b, supply, *point in samples:
        reading = SensorReading(*(np.array([x]) for x in (q, v, p_a, p_b)), supply)
        at = Point(*(np.array([x]) for x in point))
        u = made.command(DT, reading, Wanted(at, at))
        assert np.isfinite(u).all()
        assert np.abs(u).max() <= 1.0


def test_conditions_are_said_by_joint() -> None:
    said = gravest((ControlCondition.FOLLOWING, ControlCondition.PRESSURES_LOST), ("slew", JOINT))
    assert said == f"{JOINT}: pressures lost: using the load of the model"
    assert (
        gravest((ControlCondition.AT_REST, ControlCondition.FOLLOWING), ("slew", JOINT))
        == "following"
    )
