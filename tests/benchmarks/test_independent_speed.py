"""How long the plant of other make takes for a minute of motion, beside the simulated crane's."""

import time

import numpy as np
import pytest

from crane_benchmark.independent.parts import Make
from crane_benchmark.independent.plant import IndependentPlant
from crane_model import load_machine
from crane_sim import Plant, load_simulated_crane
from crane_sim.plant.sampled import RecordedMachine

pytest.importorskip("mujoco")


MINUTE = 60.0  # s
CYCLE = 0.005  # s
AT_MOST = 6.0  # s of processor time


def minute(plant: RecordedMachine) -> float:
    """Processor time of a minute of swings [s]."""
    plant.advance(np.zeros(4), CYCLE)  # compiled
    start = time.process_time()
    for t in np.arange(0.0, MINUTE, CYCLE):
        plant.advance(0.3 * np.sin(2.0 * np.pi * t / np.array([2.9, 2.3, 1.7, 2.0])), CYCLE)
    return time.process_time() - start


def test_a_minute_of_the_independent_plant_takes_seconds(measured) -> None:
    machine, simulated = load_machine(), load_simulated_crane()
    make = Make(air=1e-3, stiffening=5.0, pump_lag=0.01)
    independent = minute(IndependentPlant(simulated, machine, make, simulated.start))
    primary = minute(Plant(simulated, machine, simulated.start))
    measured(
        "a minute of motion of the plant of other make, processor time",
        "at most 6 s",
        "{independent:.1f} s; the plant of crane_sim {primary:.1f} s",
        independent=independent,
        primary=primary,
    )
    assert independent < AT_MOST
