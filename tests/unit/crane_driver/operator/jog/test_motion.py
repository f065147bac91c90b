"""Commands from demands, for any schedule of demands."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from crane_driver import constants
from crane_driver.operator.jog.jog_input import CommandShape, Demand, JogMotion
from crane_model import ConfigurationError, load_machine

JOINTS = load_machine().joint_names
SHAPE = CommandShape(
    maximum=0.3, dead_band=dict.fromkeys(JOINTS, 0.05), rise_time=0.3, fall_time=0.03
)
PERIOD = 0.01
NEUTRAL = 0.05  # the driver's: safety.yaml

levels = st.one_of(st.just(1.0), st.just(-1.0), st.floats(-1.0, 1.0))
demands = st.one_of(st.none(), st.builds(Demand, st.sampled_from(JOINTS), levels))
schedules = st.lists(st.tuples(demands, st.integers(1, 40)), min_size=1, max_size=8)


def steps(schedule: list[tuple[Demand | None, int]]) -> list[Demand | None]:
    return [demand for demand, count in schedule for _ in range(count)]


@given(schedules)
def test_commands_are_bounded_ramped_and_of_one_joint_at_a_time(
    schedule: list[tuple[Demand | None, int]],
) -> None:
    motion = JogMotion(SHAPE)
    before = dict.fromkeys(JOINTS, 0.0)
    rise = PERIOD / SHAPE.rise_time * (SHAPE.maximum - NEUTRAL)
    for number, demand in enumerate(steps(schedule)):
        commands = motion.step(demand, number * PERIOD)
        moved = [joint for joint in JOINTS if commands[joint]]
        assert len(moved) <= 1
        for joint in JOINTS:
            size, last = abs(commands[joint]), abs(before[joint])
            assert size <= SHAPE.maximum + 1e-12
            assert size <= max(last, NEUTRAL) + rise + 1e-12
            assert commands[joint] * before[joint] >= 0.0, "through neutral"
            if size > last:
                assert demand, "faster without a demand"
                assert demand.joint == joint
                assert demand.level * commands[joint] > 0
        before = commands


@given(schedules)
def test_it_begins_at_neutral_and_is_neutral_soon_after_the_last_demand(
    schedule: list[tuple[Demand | None, int]],
) -> None:
    motion = JogMotion(SHAPE)
    held = steps(schedule)
    first = motion.step(held[0], 0.0)
    assert not any(first.values())
    for number, demand in enumerate(held):
        motion.step(demand, number * PERIOD)
    now = len(held) * PERIOD
    count = round(SHAPE.fall_time / PERIOD) + 1
    last = [motion.step(None, now + number * PERIOD) for number in range(count)][-1]
    assert not any(last.values())
    assert motion.neutral


def test_a_demand_that_is_held_reaches_its_level_and_a_lower_one_is_followed() -> None:
    motion = JogMotion(SHAPE)
    motion.step(None, 0.0)
    up = [motion.step(Demand("slew", 1.0), 0.01 * n)["slew"] for n in range(1, 50)]
    assert up[-1] == pytest.approx(0.3)
    down = [motion.step(Demand("slew", 0.2), 0.5 + 0.01 * n)["slew"] for n in range(10)]
    assert down[-1] == pytest.approx(0.05 + 0.2 * 0.25)


def test_what_is_held_at_the_beginning_has_to_be_let_go_first() -> None:
    motion = JogMotion(SHAPE)
    for number in range(100):
        assert not any(motion.step(Demand("slew", 1.0), number * PERIOD).values())
    motion.step(None, 1.0)
    assert motion.step(Demand("slew", 1.0), 1.01)["slew"] > 0


def test_after_a_pause_everything_begins_at_neutral_again() -> None:
    motion = JogMotion(SHAPE)
    motion.step(None, 0.0)
    assert motion.step(Demand("slew", 1.0), 0.01)["slew"] > 0
    later = 0.02 + constants.LONGEST_PAUSE_S
    assert not any(motion.step(Demand("slew", 1.0), later).values())
    assert not any(motion.step(Demand("slew", 1.0), later + PERIOD).values())


def test_a_dead_band_must_be_less_than_the_maximum() -> None:
    wide = {**SHAPE.dead_band, "telescope": 0.3}
    with pytest.raises(ConfigurationError, match=r"'dead_band.telescope': must be less than .*0.3"):
        JogMotion(SHAPE._replace(dead_band=wide))
