"""How long the plant of other make takes for a minute of motion, beside the stand-in's."""

import time

import numpy as np
import pytest

pytest.importorskip("mujoco")

from crane_benchmark.away.parts import Make
from crane_benchmark.away.plant import AwayPlant
from crane_model.machine import load_machine
from crane_sim.parts.parameters import load_stand_in
from crane_sim.plant.plant import Plant
from crane_sim.plant.sampled import RecordedMachine

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


def test_a_minute_away_takes_seconds(measured) -> None:
    machine, stand_in = load_machine(), load_stand_in()
    make = Make(air=1e-3, stiffening=5.0, pump_lag=0.01)
    away = minute(AwayPlant(stand_in, machine, make, stand_in.start))
    home = minute(Plant(stand_in, machine, stand_in.start))
    measured(
        "a minute of motion of the plant of other make, processor time",
        "at most 6 s",
        "{away:.1f} s; the stand-in's plant {home:.1f} s",
        away=away,
        home=home,
    )
    assert away < AT_MOST
