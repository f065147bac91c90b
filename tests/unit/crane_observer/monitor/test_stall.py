"""A boom that its load stalls, with its valve open, is no fault of its sensors."""

import numpy as np
import pytest
from unit.crane_observer.monitor.at_work import Heard

from crane_benchmark.observing.machines import LiftingPlant, WorkCycles, stock
from crane_model import Model
from crane_observer.monitor.tolerance import Tolerance
from crane_sim import Sensors, record

OUTER = 1  # of the joints of the model
STANDS = 0.02  # rad/s, at most
OPEN = 0.5  # of the stroke, by which a boom that is free goes fast
STALLED = 10.0  # s, at least


def heard(model: Model, noise: int) -> Heard:
    """A crane is to lift 150 kg, more than its outer boom can out there."""
    observed = stock()
    low, high = np.array([0.0, 0.781, -2.166, 0.974]), np.array([0.0, 0.781, -0.551, 1.284])
    cycles = WorkCycles(
        np.array([low, low, high, high]), np.array([1.0, 5.0, 20.0]),
        np.array([3.0, 18.0, 28.0]), np.array([0.0, 150.0, 150.0]), np.zeros(3),
    )  # fmt: skip
    machine, simulated = observed.machine, observed.simulated
    plant = LiftingPlant(simulated, machine, cycles, observed.hidden)
    made = record(cycles, plant, Sensors(simulated.sensors, machine, noise), observed.gains)
    columns, shown = [machine.index(joint) for joint in model.joints], made.pressures
    return Heard(
        made.time, made.position[:, columns], shown.chamber_a, shown.chamber_b, shown.supply,
        made.command[:, columns],
    )  # fmt: skip


@pytest.mark.parametrize("noise", [8, 9])
def test_a_boom_that_its_load_stalls_is_no_fault(
    model: Model, untrimmed: Tolerance, noise: int
) -> None:
    work = heard(model, noise)
    stands = np.abs(np.gradient(work.q[:, OUTER], work.time)) < STANDS
    stalled = stands & (np.abs(work.command[:, OUTER]) > OPEN)
    assert np.count_nonzero(stalled) * np.median(np.diff(work.time)) > STALLED
    assert work.to(model, untrimmed).monitor.findings == []
