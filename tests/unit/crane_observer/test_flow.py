"""What flows over an interval, where a valve or a transducer comes to its end."""

from dataclasses import replace

import numpy as np
import pytest
from unit.crane_observer.observed import known

from crane_model import Model
from crane_model.hydraulics import Measured
from crane_model.hydraulics.simulation import circuit_of
from crane_model.hydraulics.stepping import roots
from crane_observer.position.flow import (
    FLOW_SUMS,
    SPOOL,
    Commands,
    add_interval,
    spools_of,
)

LAG, PERIOD = 0.012, 0.005  # s
LARGEST = 25e6  # Pa


def lagging(frequency: float) -> Model:
    """Valves of which slow motion lags by LAG, whatever their frequency [rad/s] was told as."""
    model = known()
    assert model.hydraulics is not None
    told = {
        "lag": Measured(value=LAG, unit="s"),
        "natural_frequency": Measured(value=frequency, unit="rad/s"),
    }
    joints = {
        name: values.model_copy(update={"valve": values.valve.model_copy(update=told)})
        for name, values in model.hydraulics.joints.items()
    }
    return replace(model, hydraulics=model.hydraulics.model_copy(update={"joints": joints}))


@pytest.mark.parametrize("frequency", [60.0, 108.0, 200.0, 2000.0])
def test_a_spool_follows_a_ramp_by_the_lag_that_was_measured(frequency: float) -> None:
    model = lagging(frequency)
    circuit, spools = circuit_of(model), spools_of(model)
    commands, spool, sums = Commands.none(3), np.zeros(3, SPOOL), np.zeros(3, FLOW_SUMS)
    p, rate, count = np.full((2, 3), 8e6), 0.5, 200
    for k in range(count):
        now = k * PERIOD
        commands.add(now, np.full(3, rate * now))
        end = now + PERIOD
        add_interval(circuit, spools, commands, spool, 0.0, now, end, p, p, 17e6, LARGEST, sums)
    held = 0.5 * PERIOD  # a command that is held is late by this on the mean
    wanted = rate * (count * PERIOD - held - LAG)
    assert np.abs(spool["position"]) == pytest.approx(wanted, abs=rate * 0.3 * PERIOD)


@pytest.mark.parametrize(
    ("before", "after", "lost"),
    [
        (24.0e6, 24.6e6, False),
        (24.0e6, LARGEST, True),  # whatever the pressure is by then
        (LARGEST, 24.0e6, True),
        (3e6, 2e6, False),
        (3e6, 1e4, True),  # it may suck oil past its valve
    ],
)
def test_flow_is_not_known_where_either_reading_is_at_an_end(
    before: float, after: float, lost: bool
) -> None:
    model = known()
    circuit, spools = circuit_of(model), spools_of(model)
    commands, spool, sums = Commands.none(3), np.zeros(3, SPOOL), np.zeros(3, FLOW_SUMS)
    first, last = np.full((2, 3), 8e6), np.full((2, 3), 8e6)
    first[1, 1], last[1, 1] = before, after
    add_interval(
        circuit, spools, commands, spool, 0.0, 0.0, PERIOD, first, last, 17e6, LARGEST, sums
    )
    assert (sums["lost"][:, 1] > 0.0).tolist() == [False, lost, False]
    assert not sums["lost"][:, 0].any()


@pytest.mark.parametrize(
    ("command", "p_a", "p_b", "faint"),
    [
        (1.0, 16.94e6, 8e6, (True, False)),  # a load stalls the piston
        (1.0, 17.06e6, 8e6, (True, False)),  # or presses oil back
        (-1.0, 8e6, 16.94e6, (False, True)),
        (-1.0, 0.3e6, 8e6, (True, False)),  # at the tank
        (1.0, 8e6, 16.94e6, (False, False)),  # B drains with all of it
        (1.0, 16.0e6, 1.5e6, (False, False)),
        (0.0, 17.0e6, 0.2e6, (False, False)),  # nothing passes a valve that is shut
    ],
)
def test_an_open_edge_without_a_drop_is_faint(
    command: float, p_a: float, p_b: float, faint: tuple[bool, bool]
) -> None:
    model = known()
    circuit, spools = circuit_of(model), spools_of(model)
    commands, spool, sums = Commands.none(3), np.zeros(3, SPOOL), np.zeros(3, FLOW_SUMS)
    spool["position"] = spool["edge"] = command
    commands.add(-1.0, command * spools.sense)
    p = np.repeat(np.array([[p_a], [p_b]]), 3, axis=1)
    add_interval(circuit, spools, commands, spool, 0.0, 0.0, PERIOD, p, p, 17e6, LARGEST, sums)
    for chamber, wanted in enumerate(faint):
        assert sums["faint"][:, chamber] == pytest.approx(PERIOD if wanted else 0.0)


@pytest.mark.parametrize("command", [-0.7, 0.7])
def test_what_flows_grows_with_the_root_of_the_drop(command: float) -> None:
    model = known()
    circuit, spools = circuit_of(model), spools_of(model)
    commands, spool, sums = Commands.none(3), np.zeros(3, SPOOL), np.zeros(3, FLOW_SUMS)
    spool["position"] = spool["edge"] = command
    commands.add(-1.0, command * spools.sense)
    p, supply, tank = np.repeat([[6e6], [9e6]], 3, axis=1), 17e6, circuit.tank_pressure
    add_interval(circuit, spools, commands, spool, 0.0, 0.0, PERIOD, p, p, supply, LARGEST, sums)
    leaked = PERIOD * circuit.leakage * (p[0] - p[1])
    drops = (supply - p[0], p[1] - tank) if command > 0.0 else (p[0] - tank, supply - p[1])
    flows = sums["flow"].T + np.array([leaked, -leaked])
    for wide, drop, flow in zip(sums["wide"].T, drops, flows, strict=True):
        assert wide * roots(drop) == pytest.approx(flow, rel=1e-9)


@pytest.mark.parametrize(
    ("supply", "other", "ratio"),
    [
        (12e6, 10e6, 1.0),  # 2 MPa over its own load as over the other
        (16e6, 14e6, 1.0),  # its own drop would be 6 MPa, but the other load shares 2 MPa
        (16e6, 15e6, 0.5**0.5),
        (30e6, 1e6, 2.0**0.5),  # no more than the pump may leave
    ],
)
def test_valves_that_share_a_pump_have_its_pressure_over_the_highest_load(
    supply: float, other: float, ratio: float
) -> None:
    """The flow of one joint at 10 MPa, over that at 2 MPa; another joint is open as far."""
    model = known()
    circuit, spools = circuit_of(model), spools_of(model)._replace(largest_drop=4e6)
    flows = []
    for pressure, load in ((supply, other), (12e6, 10e6)):
        commands, spool, sums = Commands.none(3), np.zeros(3, SPOOL), np.zeros(3, FLOW_SUMS)
        spool["position"] = spool["edge"] = 1.0
        commands.add(-1.0, spools.sense)
        p = np.full((2, 3), 1e6)
        p[0, 0], p[0, 1] = 10e6, load
        add_interval(
            circuit, spools, commands, spool, 0.0, 0.0, PERIOD, p, p, pressure, LARGEST, sums
        )
        flows.append(sums["flow"][0, 0])
    assert flows[0] == pytest.approx(ratio * flows[1], rel=0.02)
