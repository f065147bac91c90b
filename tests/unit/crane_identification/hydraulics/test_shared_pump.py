"""Valves that share the flow of one pump: the drop at the edges that feed."""

from dataclasses import replace

import numpy as np
import pytest

from crane_identification.hydraulics.balance import METERING_DROP, ChamberRows, Passage, SpoolValues
from crane_identification.hydraulics.joint_estimate import HighestLoads, early_spool
from crane_identification.hydraulics.projection import BalanceFit
from crane_model import load_machine
from crane_model.hydraulics import Measured
from crane_model.machine import LoadSensing

MARGIN, TANK, STEP_S = 2.0e6, 0.3e6, 0.02
SENSING = LoadSensing(margin=MARGIN, power=1e5)
MACHINE = load_machine("field_excavator")
OPEN = SpoolValues(lag=0.02, share=0.5, dead_band_a=0.1, dead_band_b=0.1, play=0.0)


def passage(command: float) -> Passage:
    """Ten seconds in which the boom's valve is open and its chamber A at 10 MPa."""
    time = STEP_S * np.arange(500)
    pressures = {"pressure_a": 1.0e7, "pressure_b": 1.0e6, "supply_pressure": 1.5e7,
                 "tank_pressure": TANK}  # fmt: skip
    return Passage(
        source="bag",
        step=STEP_S,
        time=time,
        length=2.5 + 0.1 * time / time[-1],
        counts=np.arange(500.0),
        resolution=np.full(500, 1e-4),
        pressures={name: np.full(500, value) for name, value in pressures.items()},
        stamps=time,
        commands=np.full(500, command),
    )


def test_the_drop_is_supply_over_the_highest_load() -> None:
    """Which another joint has; above the supply, a load leaves none."""
    time = np.array([0.0, 4.0, 4.001, 8.0, 8.001, 20.0])
    load = np.array([1.35e7, 1.35e7, 1.6e7, 1.6e7, 0.3e6, 0.3e6])
    shared = HighestLoads(SENSING, {"bag": (time, load)}).shared(passage(0.5))
    drop = shared.pressures[METERING_DROP]
    assert drop[100] == pytest.approx(1.5e6)
    assert drop[300] == 0.0
    assert drop[450] == SENSING.largest_drop


def test_a_recording_of_which_no_load_is_known_has_the_margin() -> None:
    drop = HighestLoads(SENSING, {}).shared(passage(0.5)).pressures[METERING_DROP]
    assert (drop == MARGIN).all()


@pytest.mark.parametrize(("command", "edge"), [(0.5, 0), (-0.5, 2)])
def test_edges_that_feed_pass_by_that_drop_and_returns_by_their_own(
    command: float, edge: int
) -> None:
    """Chamber A is fed by the supply edge of A and B returns; the other way round, likewise."""
    time = np.array([0.0, 20.0])
    cylinder = MACHINE.cylinders["boom"]
    flows = []
    for load in (1.35e7, 1.2e7):
        loads = HighestLoads(SENSING, {"bag": (time, np.full(2, load))})
        rows = ChamberRows(loads.shared(passage(command)), cylinder)
        columns = rows.columns(OPEN)[len(rows.time) // 2]
        flows.append(columns[:, :4].sum(axis=0))
    first, second = flows
    assert second[edge] / first[edge] == pytest.approx(2.0**0.5, rel=0.02)
    returns = 3 if edge == 0 else 1
    assert second[returns] == pytest.approx(first[returns])
    assert first[returns] < 0.0 < first[edge]


def test_a_chamber_that_is_fed_is_at_most_the_highest_load() -> None:
    """Whatever the load is taken for: nothing else keeps a wrong opening of this valve right."""
    time, cylinder = np.array([0.0, 20.0]), MACHINE.cylinders["boom"]
    flows = []
    for load, p_a in ((1.35e7, 1.0e7), (0.3e6, 1.35e7)):
        loads = HighestLoads(SENSING, {"bag": (time, np.full(2, load))})
        part = passage(0.5)
        part = replace(part, pressures={**part.pressures, "pressure_a": np.full(500, p_a)})
        rows = ChamberRows(loads.shared(part), cylinder)
        flows.append(rows.columns(OPEN)[len(rows.time) // 2, 0, 0])
    assert flows[1] == pytest.approx(flows[0])
    assert flows[0] > 0.0


def test_a_drop_that_transducers_hardly_tell_from_none_does_not_count() -> None:
    time, cylinder = np.array([0.0, 20.0]), MACHINE.cylinders["boom"]
    for load, counts in ((1.45e7, True), (1.48e7, False)):
        shared = HighestLoads(SENSING, {"bag": (time, np.full(2, load))}).shared(passage(0.5))
        assert ChamberRows(shared, cylinder).columns(OPEN).any() == counts


@pytest.mark.parametrize(("share", "named"), [(0.5, False), (1.05, False), (1.5, True)])
def test_a_spool_that_moves_before_its_command_tells_no_lag(share: float, named: bool) -> None:
    """As of the swing, when its own load was missing: 0.39 s, and 0.2 s before the command."""
    empty = np.zeros((0, 0))
    spool = SpoolValues(lag=0.39, share=share, dead_band_a=0.1, dead_band_b=0.1, play=0.0)
    found = BalanceFit(spool, np.zeros(8), empty, empty, empty, 0.079)
    lag = Measured(value=0.39, std_dev=0.029, unit="s")
    assert ("lag" in early_spool(found, {"lag": lag})) == named
