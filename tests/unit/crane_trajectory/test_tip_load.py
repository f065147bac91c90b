"""A load at the tip that a scale tells: how far it is believed, and that no command jumps by it."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from known_crane import known_model
from unit.crane_trajectory.one_joint import DT, PERIOD, Boom, hydraulics, model
from unit.crane_trajectory.test_flow_feedforward import controller, jump

from crane_model import tip_position
from crane_trajectory.control.controller import SensorReading, Wanted
from crane_trajectory.control.flow_feedforward import (
    LOAD_RATE,
    LONGEST_CYCLE,
    OLDEST_LOAD,
    FedLoad,
    ReferenceLoad,
    ToldLoad,
)

SURE = ToldLoad(0.0, 100.0, 0.5, "GOOD")
ANYTHING = st.floats(allow_nan=True, allow_infinity=True)


def settled(told: ToldLoad, time: float = 0.5) -> float:
    """What the crane is led with after a while in which nothing else was told [kg]."""
    fed = FedLoad(150.0)
    fed.tell(told)
    for _ in range(round(150.0 / LOAD_RATE / LONGEST_CYCLE) + 1):
        fed.at(time - LONGEST_CYCLE)
        fed.at(time)
    return fed.mass


def test_a_sure_load_is_led_with() -> None:
    assert settled(SURE) == pytest.approx(100.0, rel=1e-3)


@pytest.mark.parametrize(
    "told",
    [
        SURE._replace(mass=151.0),
        SURE._replace(mass=-20.0),
        SURE._replace(mass=math.nan),
        SURE._replace(mass=math.inf),
        SURE._replace(deviation=math.nan),
        SURE._replace(deviation=math.inf),
        SURE._replace(deviation=-1.0),
        SURE._replace(condition="POSITIONS_ESTIMATED"),
        SURE._replace(condition="PRESSURES_LOST"),
        SURE._replace(condition=""),
        SURE._replace(time=-OLDEST_LOAD),
        SURE._replace(time=2.0 * OLDEST_LOAD),
        SURE._replace(time=math.nan),
    ],
)
def test_what_is_impossible_degraded_or_old_counts_as_nothing(told: ToldLoad) -> None:
    assert settled(told) == 0.0


def test_one_that_may_be_nothing_counts_as_next_to_nothing() -> None:
    assert settled(SURE._replace(mass=20.0, deviation=100.0)) < 1.0
    assert settled(SURE._replace(mass=20.0, deviation=20.0)) == pytest.approx(10.0)


@given(st.lists(st.tuples(ANYTHING, ANYTHING, ANYTHING), max_size=30))
def test_whatever_is_told_the_mass_is_bounded_and_goes_at_a_bounded_rate(
    tellings: list[tuple[float, float, float]],
) -> None:
    fed, before = FedLoad(150.0), 0.0
    for k, (time, mass, deviation) in enumerate(tellings):
        fed.tell(ToldLoad(time, mass, deviation, "GOOD"))
        now = fed.at(DT * k)
        assert 0.0 <= now <= 150.0
        assert abs(now - before) <= LOAD_RATE * LONGEST_CYCLE + 1e-9
        before = now


def test_a_clock_that_stops_or_goes_back_moves_nothing() -> None:
    fed = FedLoad(150.0)
    fed.tell(SURE)
    assert [fed.at(time) for time in (0.5, 0.5, 0.2)] == [0.0, 0.0, 0.0]


def test_a_mass_at_the_tip_asks_for_its_weight() -> None:
    """By virtual work: the load of each joint is the weight times how the tip rises with it."""
    known = known_model()
    machine = known.machine
    assert machine is not None
    q, still = np.array([0.0, 0.4, -1.2, 0.5]), np.zeros(4)
    load = ReferenceLoad(known, machine)
    without = load(q, still, still)
    load.at_tip = 80.0

    def height(at: np.ndarray) -> float:
        return float(tip_position(machine, at[None])[0, 2])

    steps = 1e-5 * np.eye(4)
    rises = np.array([(height(q + step) - height(q - step)) / 2e-5 for step in steps])
    asked = load(q, still, still) - without
    np.testing.assert_allclose(asked[1:], 80.0 * machine.gravity * rises[1:], rtol=1e-5)
    assert asked[0] == 0.0  # the slew is not in the model


def test_a_load_that_comes_and_goes_in_motion_makes_no_command_jump() -> None:
    class Fed:
        """Told of a load that nobody carries, and that it has gone."""

        def __init__(self, mass: float) -> None:
            self.made, self.fed, self.time = controller(pressures=False), FedLoad(mass), -0.2
            self.mass = mass

        def __getattr__(self, name: str) -> object:
            return getattr(self.made, name)

        def command(self, dt: float, reading: SensorReading, wanted: Wanted) -> np.ndarray:
            self.time += dt
            carried = self.mass if 1.0 < self.time < 5.0 else 0.0
            self.fed.tell(ToldLoad(self.time, carried, 0.1, "GOOD"))
            self.made.carry(self.fed.at(self.time))
            return self.made.command(dt, reading, wanted)

    fed, without = Fed(60.0), Fed(0.0)
    course, plain = (
        Boom(controller, hydraulics()).run(2.0 * PERIOD) for controller in (fed, without)
    )
    assert model().machine is not None
    assert np.abs(course.command - plain.command).max() > 0.005  # it was led with it
    assert jump(course, 0.5, 2.0 * PERIOD) < 1.1 * jump(plain, 0.5, 2.0 * PERIOD)
