"""Orifices, chambers, spool, pump and relief valve."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.signal import lsim

from crane_model import Machine
from crane_model.hydraulics.stepping import transition
from crane_sim import SimulatedCrane
from crane_sim.parts.constants import pack
from crane_sim.parts.cylinders import (
    Oil,
    chamber_step,
    conductances,
    opening,
    port_flow,
    pump_flow,
    relief_flow,
    signed_root,
    spool_step,
)
from crane_sim.parts.parameters import Edges

LAMINAR = 1e5
drops = st.floats(-3e7, 3e7)


@pytest.fixture(scope="module")
def oil(machine: Machine, simulated: SimulatedCrane) -> Oil:
    """The oil of the simulated crane."""
    return pack(simulated, machine).oil


EDGES = {"supply_a": 1.1, "a_tank": 0.9, "supply_b": 0.7, "b_tank": 0.6}


@pytest.mark.parametrize(
    ("x", "at_a", "at_b"), [(0.4, "supply_a", "b_tank"), (-0.4, "a_tank", "supply_b")]
)
def test_each_metering_edge_has_a_gain_of_its_own(
    machine: Machine, simulated: SimulatedCrane, x: float, at_a: str, at_b: str
) -> None:
    """Over a drop of 3.5 MPa an edge passes its share of the rated flow."""
    given = simulated.valves["telescope"]
    edges = given.model_copy(update={"edges": Edges(**EDGES)})
    valves = {**simulated.valves, "telescope": edges}
    uneven = pack(simulated.model_copy(update={"valves": valves}), machine)
    supply, drop = 17.5e6, given.rated_drop
    wanted_a, wanted_b = (share * given.rated_flow * x for share in (EDGES[at_a], -EDGES[at_b]))
    fed, drained = supply - drop, uneven.oil.tank_pressure + drop
    open_a, open_b = conductances(uneven.valves[3], x)
    at_a_flow, _ = port_flow(uneven.oil, open_a, supply, fed if x > 0 else drained)
    at_b_flow, _ = port_flow(uneven.oil, open_b, supply, drained if x > 0 else fed)
    assert (at_a_flow, at_b_flow) == pytest.approx((wanted_a, wanted_b), rel=1e-3)


@given(drop=drops, other=drops)
def test_orifice_is_odd_increasing_and_lipschitz(drop: float, other: float) -> None:
    """Root of the pressure drop, smoothed so that its slope is at most 1/sqrt(laminar drop)."""
    root, slope = signed_root(drop, LAMINAR)
    assert root == -signed_root(-drop, LAMINAR)[0]
    assert 0.0 < slope <= 1.0 / np.sqrt(LAMINAR) * (1 + 1e-12)
    difference = root - signed_root(other, LAMINAR)[0]
    assert difference * (drop - other) >= 0.0
    assert abs(difference) <= abs(drop - other) / np.sqrt(LAMINAR) * (1 + 1e-9)


@pytest.mark.parametrize("drop", [-2e7, -1e6, 1e6, 2e7])
def test_orifice_is_turbulent_far_from_zero_and_its_slope_is_its_derivative(drop: float) -> None:
    """sgn(d) sqrt|d|; derivative by central differences."""
    root, slope = signed_root(drop, LAMINAR)
    assert root == pytest.approx(np.sign(drop) * np.sqrt(abs(drop)), rel=3e-3)
    step = 10.0
    ahead, behind = signed_root(drop + step, LAMINAR)[0], signed_root(drop - step, LAMINAR)[0]
    assert slope == pytest.approx((ahead - behind) / (2 * step), rel=1e-6)


def test_oil_flows_down_the_pressure(oil: Oil) -> None:
    """From supply into a chamber below it, from a chamber above tank to tank; not backwards."""
    supply = 17.5e6
    assert port_flow(oil, 1e-7, supply, 5e6)[0] > 0.0
    assert port_flow(oil, 1e-7, supply, 18e6)[0] < 0.0
    assert port_flow(oil, -1e-7, supply, 5e6)[0] < 0.0
    assert port_flow(oil, 0.0, supply, 5e6)[0] == 0.0


@given(
    flow=st.floats(-1e-4, 1e-4),
    growth=st.floats(-1e-4, 1e-4),
    p=st.floats(1e6, 1.5e7),
    p_other=st.floats(1e6, 1.5e7),
)
def test_oil_that_flows_in_fills_is_compressed_or_leaks(
    oil: Oil, flow: float, growth: float, p: float, p_other: float
) -> None:
    """Mass balance of a step: in = volume change + compression + leakage at the new pressure."""
    volume, leakage, step = 1e-3, 2e-13, 2e-4
    after, entered = chamber_step(oil, p, p_other, flow, -1e-11, leakage, volume, growth, step)
    compressed = volume / oil.bulk_modulus * (after - p)
    leaked = step * leakage * (after - p_other)
    assert step * entered == pytest.approx(step * growth + compressed + leaked, abs=1e-15)


def test_dead_band_and_stroke_of_the_spool(machine: Machine, simulated: SimulatedCrane) -> None:
    """Nothing opens inside the overlap; the spool reaches its command and stops at its end."""
    assert opening(0.05, 0.06) == opening(-0.06, 0.06) == 0.0
    assert opening(1.0, 0.06) == 1.0 and opening(-1.0, 0.06) == -1.0
    for valve in pack(simulated, machine).valves:
        free = transition(valve["frequency"], valve["damping_ratio"], 1e-4)
        for command in (0.3, 5.0):
            position = rate = 0.0
            for _ in range(5_000):
                position, rate = spool_step(valve, free, command, position, rate, 1e-4)
                assert abs(position) <= 1.0
                assert abs(rate) <= valve["rate_limit"] * (1 + 1e-12)
            assert position == pytest.approx(valve["sense"] * min(command, 1.0), abs=1e-6)


@pytest.mark.parametrize("step", [2e-4, 1e-3, 5e-3])
def test_spool_is_of_second_order_at_any_step(
    machine: Machine, simulated: SimulatedCrane, step: float
) -> None:
    """Against SciPy's simulation of the transfer function, where no limit holds it back."""
    command, count = 0.1, 60
    for valve in pack(simulated, machine).valves:
        frequency, damping_ratio = valve["frequency"], valve["damping_ratio"]
        system = ([frequency**2], [1.0, 2.0 * damping_ratio * frequency, frequency**2])
        time = step * np.arange(1, count + 1)
        wanted = lsim(system, np.full(count + 1, command), np.append(0.0, time))[1][1:]
        free, position, rate, found = transition(frequency, damping_ratio, step), 0.0, 0.0, []
        for _ in range(count):
            position, rate = spool_step(valve, free, command, position, rate, step)
            found.append(valve["sense"] * position)
        assert found == pytest.approx(wanted, abs=1e-9)


def test_pump_is_limited_and_relief_opens(oil: Oil) -> None:
    """No delivery at the set pressure, all of it below the droop; relief only above its limit."""
    assert pump_flow(oil, oil.set_pressure, 0.0) == 0.0
    assert pump_flow(oil, oil.set_pressure - 2 * oil.droop, 0.0) == oil.pump_flow
    assert relief_flow(oil, oil.relief_pressure, 0.0) == 0.0
    assert relief_flow(oil, oil.relief_pressure + 1e6, 0.0) > 0.0
