"""Ramps on the simulated crane: a heavy slew on soft oil is given the time that it needs."""

from types import SimpleNamespace

import numpy as np
import pytest

from crane_driver.operator.bringup.bench import Bench
from crane_driver.operator.bringup.estimates import JointInstant, Rest, average
from crane_driver.operator.bringup.motion import Mover, Tick
from crane_driver.operator.bringup.steps import unhurried
from crane_model import DataError, load_machine
from crane_sim import Plant, load_simulated_crane

MACHINE, SIMULATED = load_machine(), load_simulated_crane()
PERIOD, PER_TICK = 0.005, 2
RESOLUTION = 4.8e-5


class Driven:
    """One joint of the plant in the hands of the program."""

    def __init__(self, joint: str):
        self.plant = Plant(SIMULATED, MACHINE, SIMULATED.start)
        self.column, self.now = MACHINE.index(joint), 0.0

    def tick(self, command: float) -> Tick:
        sent, samples = self.now, []
        commands = np.zeros(len(SIMULATED.start))
        commands[self.column] = command
        for _ in range(PER_TICK):
            self.now += PERIOD
            self.plant.advance(commands, PERIOD)
            shown = RESOLUTION * np.round(self.plant.q / RESOLUTION)
            samples.append(JointInstant(self.now, shown, self.plant.v.copy()))
        return Tick(sent, samples)


def ramped(joint: str, rate: float) -> tuple[float, float, float, list[str]]:
    """The rate that it came to, dead band and gain [rad/s] found, and what was said."""
    said: list[str] = []
    protocol = SimpleNamespace(rate=rate, speed=0.04, limit=0.25, repeats=1)
    terminal = SimpleNamespace(say=said.append)
    bench = Bench(None, terminal, *[None] * 7, (joint,), protocol)
    rests = [Rest(q, 0.0, RESOLUTION) for q in SIMULATED.start.tolist()]
    last, runs = unhurried(bench, Mover(Driven(joint), MACHINE.joint_names, joint, rests, 1.0))
    found = average([fit for _, fit in runs[1]], last)
    return last, found.dead_band, found.gain, said


def steady_speed(joint: str, command: float) -> float:
    driven = Driven(joint)
    for _ in range(300):
        driven.tick(command)
    before = driven.plant.q[driven.column]
    for _ in range(100):
        driven.tick(command)
    return float(driven.plant.q[driven.column] - before)


def test_a_heavy_slew_is_given_time_until_two_rates_agree() -> None:
    rate, dead_band, gain, said = ramped("slew", 0.05)
    assert rate < 0.02
    assert "answers" in said[0] and "late to a ramp of 0.05/s" in said[0]
    true = (steady_speed("slew", 0.07) - steady_speed("slew", 0.06)) / 0.01
    assert gain == pytest.approx(true, rel=0.05)
    assert dead_band == pytest.approx(SIMULATED.valves["slew"].dead_band, abs=1e-3)


def test_a_light_joint_is_measured_at_once() -> None:
    rate, dead_band, _, said = ramped("inner_boom", 0.05)
    assert (rate, said) == (0.05, [])
    assert dead_band == pytest.approx(SIMULATED.valves["inner_boom"].dead_band, abs=1e-3)


def test_a_joint_that_no_ramp_tells_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("crane_driver.constants.SLOWEST_RATE_RATIO", 1.0)
    with pytest.raises(
        DataError, match="slew: answers .* that determines no dead band; give a smaller"
    ):
        ramped("slew", 0.05)
