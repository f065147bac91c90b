"""Oil that a load presses back into the supply line is no fault of the supply's transducer."""

import numpy as np
import pytest
from unit.crane_observer.monitor.at_work import Heard

from crane_benchmark.observing.machines import LiftingPlant, WorkCycles, stock
from crane_model import Model
from crane_observer.monitor.blocks import LARGEST_SURPLUS, SupplyLine
from crane_observer.monitor.tolerance import Tolerance
from crane_sim import Sensors, record

SET, DROOP = 17.5e6, 6.7e8  # Pa, Pa s/m3
STIFFNESS = 1.3e9 / 4e-3  # Pa/m3, of the oil in the line
BLOCK, STEP = 0.05, 1e-4  # s
NOTICED = 2e4  # Pa


def blocks(flow: np.ndarray, shown: float = 0.0) -> list[tuple[bool, float]]:
    """Of each block of a line from which `flow` (n,) [m3/s] is drawn: whether it may hold a
    surplus, and how far its pressure is from p_0 less the droop [Pa] in the mean; its transducer
    shows `shown` [Pa] too much.
    """
    line, pressure, told = SupplyLine(), SET, []
    for drawn in flow:
        sum_ = 0.0
        for _ in range(round(BLOCK / STEP)):
            pumped = max((SET - pressure) / DROOP, 0.0)  # nothing flows back through it
            pressure += STEP * STIFFNESS * (pumped - drawn)
            sum_ += pressure
        above = sum_ * STEP / BLOCK - SET
        droop = DROOP * max(drawn, 0.0)
        told.append((line.add(droop, above + shown, BLOCK), above + droop))
    return told


@pytest.mark.parametrize("rest", [0, 3, 200])
@pytest.mark.parametrize("back", [1e-5, 1e-4])
def test_the_line_is_followed_until_as_much_is_drawn_as_was_pressed_back(
    back: float, rest: int
) -> None:
    calm, fed = [3e-5] * 40, [2e-5] * 60
    told = blocks(np.array([*calm, -back, *[0.0] * rest, *fed]))
    compared = [off for surplus, off in told[:40] + told[41 + rest :] if not surplus]
    assert max(compared) < NOTICED
    assert any(off > NOTICED for _, off in told[41 + rest :])
    assert not told[39][0]  # before it
    assert not told[-1][0]


def test_a_transducer_that_shows_too_much_does_not_make_a_surplus_of_it() -> None:
    told = blocks(np.array([*[3e-5] * 40, -1e-5, *[2e-5] * 60]), shown=2e6)
    surplus = np.flatnonzero([surplus for surplus, _ in told[20:]])
    needed = LARGEST_SURPLUS / (DROOP * 2e-5 * BLOCK)  # blocks in which so much is drawn
    assert surplus[0] >= 21
    assert surplus[-1] < 21 + np.ceil(needed)


def heard(model: Model) -> Heard:
    """A load of 147 kg comes to a crane that is stretched out; then the outer boom goes down."""
    observed, stand = stock(), np.array([0.0, 0.55, -0.53, 1.16])
    poses = np.array([stand, stand, stand + [0.0, 0.0, -0.87, 0.0]])
    cycles = WorkCycles(
        poses, np.array([1.0, 4.0]), np.array([3.0, 9.0]), np.array([0.0, 147.0]), np.zeros(2)
    )
    machine, simulated = observed.machine, observed.simulated
    plant = LiftingPlant(simulated, machine, cycles, observed.hidden)
    sensors = Sensors(simulated.sensors, machine, 5)
    made = record(cycles, plant, sensors, observed.gains)
    columns, shown = [machine.index(joint) for joint in model.joints], made.pressures
    return Heard(
        made.time, made.position[:, columns], shown.chamber_a, shown.chamber_b, shown.supply,
        made.command[:, columns],
    )  # fmt: skip


def test_a_load_that_presses_oil_back_is_no_fault(model: Model, tolerance: Tolerance) -> None:
    work = heard(model)
    assert work.supply.max() > SET + 5e5
    assert work.to(model, tolerance).monitor.findings == []
