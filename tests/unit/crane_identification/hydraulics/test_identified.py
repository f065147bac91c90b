"""Valves, oil and supply identified from recordings of a machine whose values are known."""

from dataclasses import replace

import numpy as np
import pytest
from unit.crane_identification.hydraulics.valve_experiments import (
    FITTED,
    MACHINE,
    PERIOD,
    SILENT,
    play,
    recorded,
    truth,
)

from crane_identification import Log, Signal
from crane_identification.hydraulics.balance import passages
from crane_identification.hydraulics.joint_estimate import (
    identify_hydraulics,
    identify_joint,
    identify_motion,
)
from crane_model import DataError, load_model
from crane_model.machine_files import machine_file
from crane_sim import SimulatedCrane, load_simulated_crane
from crane_sim.effects.form import InjectedForm
from crane_sim.effects.kernel import FORMS

WIDTH = 0.01
TOLERANCE = {"lag": 5e-4, "hysteresis": 3e-4}  # absolute; of the others relative:
RELATIVE = {"dead_band": 0.001, "bulk": 0.05, "dead_volume": 0.3, "leakage": 0.2}
GAINS = 0.001


@pytest.fixture(scope="module")
def simulated() -> SimulatedCrane:
    """With the two directions of the outer boom's valve unequal by 20 %."""
    simulated = load_simulated_crane()
    valve = simulated.valves["outer_boom"]
    edges = {"supply_a": 1.1, "b_tank": 1.1, "supply_b": 0.9, "a_tank": 0.9}
    unequal = valve.model_copy(
        update={"edges": valve.edges.model_copy(update=edges), "null_bias": 0.01}
    )
    valves = simulated.valves | {"outer_boom": unequal}
    return simulated.model_copy(update={"valves": valves})


@pytest.fixture(scope="module")
def log(simulated: SimulatedCrane) -> Log:
    """Commands are late by 10 ms, and logged from SILENT on."""
    return recorded(simulated, seed=1, periods=2, effects=[play("outer_boom", WIDTH)], live=True)


def test_a_live_recording_tells_valves_oil_and_supply(log: Log, simulated: SimulatedCrane) -> None:
    model = load_model(machine_file("model.yaml"))
    found = identify_hydraulics(model, [log], PERIOD)
    assert found is not None
    assert "'slew': its cylinder extends for 0 s" in found.unknown["slew"]
    for joint in FITTED:
        hydraulics = found.joints[joint]
        true = truth(simulated, joint, WIDTH if joint == "outer_boom" else 0.0)
        true["lag"] += 0.010
        true.pop("natural_frequency")  # of a loop whose delay varies
        true.pop("damping_ratio")  # assumed
        for name, value in true.items():
            got = hydraulics.values[name]
            assert got.std_dev is not None
            share = next((r for key, r in RELATIVE.items() if name.startswith(key)), GAINS)
            allowed = TOLERANCE.get(name, share * value)
            assert abs(got.value - value) < allowed, (joint, name, got, value)
            assert abs(got.value - value) < 5.0 * got.std_dev + 1e-5 * value, (joint, name)
        assert hydraulics.unexplained < 0.01
        assert hydraulics.lack_of_fit is not None
        assert hydraulics.lack_of_fit > 1e-3
    assert found.supply is not None
    droop = simulated.supply.pump_droop / MACHINE.hydraulics.pump_flow
    assert found.supply.pressure.value == pytest.approx(
        MACHINE.hydraulics.supply_pressure, rel=1e-4
    )
    assert found.supply.droop.value == pytest.approx(droop, rel=0.03)


def test_a_law_that_is_none_of_these_does_not_fit() -> None:
    """Oil that air softens at low pressure: little is unexplained, but noise does not repeat."""
    form = FORMS["air_in_oil"][0]  # isothermal
    log = recorded(seed=21, periods=2, effects=[InjectedForm(form, "outer_boom", (0.1,))])
    found = identify_joint(MACHINE, "outer_boom", [log], PERIOD).values
    assert found.unexplained < 0.01
    assert found.lack_of_fit is not None
    assert found.lack_of_fit < 1e-3


def test_the_part_before_a_gap_may_be_shorter_than_a_period() -> None:
    """A computer that is too busy leaves such gaps; what follows tells the lack of fit."""
    log = recorded(seed=3, periods=3)
    first = log.position.time[0]
    kept = (log.position.time < first + 8.0) | (log.position.time > first + 9.0)
    gone = replace(log, position=Signal(log.position.time[kept], log.position.value[kept], "made"))
    found = identify_joint(MACHINE, "outer_boom", [gone], PERIOD).values
    assert found.lack_of_fit is not None
    assert found.lack_of_fit > 1e-3


@pytest.mark.parametrize("supply", [True, False], ids=["with supply", "position and command"])
def test_a_joint_without_transducers_shows_dead_bands_and_gains(supply: bool) -> None:
    simulated = load_simulated_crane()
    log = recorded(simulated, seed=2, periods=1, slewed=True)
    bare = replace(log, supply_pressure=None, tank_pressure=None, pressure_a=None, pressure_b=None)
    valve = simulated.valves["slew"]
    found = identify_motion(MACHINE, "slew", [log if supply else bare])
    assert found.chambers is None
    assert found.valve.dead_band_a.value == pytest.approx(valve.dead_band, abs=0.003)
    assert found.valve.dead_band_b.value == pytest.approx(valve.dead_band, abs=0.003)
    # less by what friction takes of the pressure
    gain = truth(simulated, "slew")["supply_a"]
    assert 0.8 * gain < found.valve.supply_a.value < gain
    assert "pressure transducers" in found.undetermined["bulk_modulus"]


def test_a_recording_is_cut_to_where_all_is_known(log: Log) -> None:
    (part,) = passages(MACHINE, "telescope", [log])
    assert part.time[0] == pytest.approx(SILENT, abs=0.01)
    silent = (log.position.time > 20.0) & (log.position.time < 20.5)
    assert log.pressure_a is not None
    holed = log.pressure_a.value.copy()
    holed[silent, FITTED.index("telescope")] = np.nan
    both = passages(
        MACHINE, "telescope", [replace(log, pressure_a=replace(log.pressure_a, value=holed))]
    )
    assert len(both) == 2
    assert both[0].time[-1] < 20.02
    assert both[1].time[0] > 20.48


def test_what_is_not_logged_or_too_little_is_said(log: Log) -> None:
    with pytest.raises(DataError, match="'telescope': made holds no command; record valve"):
        identify_joint(MACHINE, "telescope", [replace(log, command=None)])
    with pytest.raises(DataError, match="8 s each needed; record longer, or move it more"):
        identify_joint(MACHINE, "telescope", [log.during(8.0, 20.0)])
    model = load_model(machine_file("model.yaml"))
    assert identify_hydraulics(model, [replace(log, command=None)]) is None


def test_a_command_with_the_wrong_sign_is_named(log: Log) -> None:
    assert log.command is not None
    turned = replace(log.command, value=-log.command.value)
    with pytest.raises(DataError, match="the flow does not follow the valve at supply_a"):
        identify_joint(MACHINE, "telescope", [replace(log, command=turned)])


def test_exchanged_chambers_are_no_valve(log: Log) -> None:
    swapped = replace(log, pressure_a=log.pressure_b, pressure_b=log.pressure_a)
    with pytest.raises(DataError, match="negative; check sign and log of its command"):
        identify_joint(MACHINE, "inner_boom", [swapped])
