"""A plant behind a bus against the plant itself, told the same commands when they are due."""

import numpy as np
import pytest

from crane_model import load_machine
from crane_sim import Plant, load_simulated_crane
from crane_sim.plant.closed_loop import LatePlant, mean_delay

MACHINE, SIMULATED = load_machine(), load_simulated_crane()
CYCLE = 0.005  # s


def test_whole_cycles_late_is_the_plant_told_later() -> None:
    late = LatePlant(SIMULATED, MACHINE, SIMULATED.start, delay=2 * CYCLE, spread=0.0)
    beside = Plant(SIMULATED, MACHINE, SIMULATED.start)
    course = 0.5 * np.random.default_rng(5).uniform(-1.0, 1.0, (40, len(MACHINE.joint_names)))
    for k in range(len(course)):
        late.advance(course[k], CYCLE)
        beside.advance(course[k - 2] if k >= 2 else np.zeros(course.shape[1]), CYCLE)
    assert np.abs(beside.q - SIMULATED.start).max() > 1e-3
    assert late.q == pytest.approx(beside.q, abs=1e-9)
    assert late.time == pytest.approx(beside.time)


@pytest.mark.parametrize("seed", range(5))
def test_commands_keep_their_order_and_come_within_their_delay(seed: int) -> None:
    """Each command differs from all others: what reaches the valves tells which it is."""
    reached: list[tuple[float, float]] = []

    class Watched(LatePlant):
        def _run(self, duration: float) -> None:
            reached.append((self.time, float(self._in_force[0])))
            super()._run(duration)

    plant = Watched(SIMULATED, MACHINE, SIMULATED.start, delay=0.004, spread=0.02, seed=seed)
    given = 1e-5 * np.arange(1, 101)
    for one in given:
        plant.advance(np.full(len(MACHINE.joint_names), one), CYCLE)
    values = [value for _, value in reached]
    assert values == sorted(values)
    first = {value: time for time, value in reversed(reached) if value > 0.0}
    delays = np.array([time - CYCLE * (round(value / 1e-5) - 1) for value, time in first.items()])
    assert len(delays) > 40
    assert delays.min() >= 0.004 - 1e-9
    assert delays.max() <= 0.024 + 1e-9


@pytest.mark.parametrize(("period", "spread"), [(0.005, 0.01), (0.005, 0.003), (0.002, 0.009)])
def test_mean_delay_is_that_of_a_million_commands(period: float, spread: float) -> None:
    given = period * np.arange(1_000_000)
    due = given + 0.004 + np.random.default_rng(3).uniform(0.0, spread, len(given))
    waited = np.maximum.accumulate(due) - given
    assert mean_delay(period, 0.004, spread) == pytest.approx(waited.mean(), abs=2e-5)


def test_mean_delay_of_two_periods_in_closed_form() -> None:
    """Only the command before one can hold it up: (S - T)^3 / (6 S^2) more than half of S."""
    assert mean_delay(0.005, 0.005, 0.01) == pytest.approx(0.01 + 0.005**3 / (6 * 0.01**2))
