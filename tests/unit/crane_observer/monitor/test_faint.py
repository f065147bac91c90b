"""A piston that goes by an edge with next to no drop: what its transducers may show, and not."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import brentq
from unit.crane_observer.monitor.at_work import Heard

from crane_model import Model
from crane_model.hydraulics.simulation import circuit_of
from crane_model.hydraulics.stepping import chamber_flows, roots
from crane_observer import Part
from crane_observer.monitor.blocks import error_of_drop
from crane_observer.monitor.tolerance import Tolerance

TELESCOPE = 2  # of the joints of the model
PERIOD, SECONDS, ONSET = 0.005, 8.0, 4.0  # s
COMMAND = 0.5
ELSEWHERE = 6e6  # Pa, in the chambers of joints that stand
NOISE = 1.2e4  # Pa
DROP = 2.5e5  # Pa, over the edge that feeds: as a load has it that the cylinder hardly moves


def at_work(model: Model, part: Part, drop: float) -> Heard:
    """The telescope, whose chamber A or B is fed over a drop [Pa]."""
    extends, circuit = part is Part.PRESSURE_A, circuit_of(model)
    assert model.hydraulics is not None
    valve = model.hydraulics.joints["telescope"].valve
    dead = (valve.dead_band_a if extends else valve.dead_band_b).value
    opened = (COMMAND - dead) / (1.0 - dead) * (1.0 if extends else -1.0)

    def pressures(drained: float) -> tuple[float, float]:
        fed = circuit.supply_pressure - drop
        return (fed, drained) if extends else (drained, fed)

    def speeds(drained: float) -> tuple[float, float]:
        p_a, p_b = pressures(drained)
        q_a, _, q_b, _ = chamber_flows(
            circuit, TELESCOPE, opened, p_a, p_b, circuit.supply_pressure
        )
        leak, areas = circuit.leakage * (p_a - p_b), (circuit.area_a, circuit.area_b)
        a, b = (q / area for q, area in zip((q_a - leak, -q_b - leak), areas, strict=True))
        return a[TELESCOPE], b[TELESCOPE]

    drained = brentq(lambda p: np.subtract(*speeds(p)), circuit.tank_pressure, 1.7e7)
    v, drained_speeds = speeds(drained)
    assert v == pytest.approx(drained_speeds)
    count, rng = round(SECONDS / PERIOD), np.random.default_rng(5)
    time = PERIOD * np.arange(count)
    p_a, p_b = ELSEWHERE + NOISE * rng.standard_normal((2, count, 3))
    droop = circuit.droop * max(v * circuit.area_a[TELESCOPE], -v * circuit.area_b[TELESCOPE])
    p_a[:, TELESCOPE] += pressures(drained)[0] - ELSEWHERE - droop * extends
    p_b[:, TELESCOPE] += pressures(drained)[1] - ELSEWHERE - droop * (not extends)
    command, q = np.zeros((count, 3)), np.tile([0.7, -1.2, 0.7], (count, 1))
    command[:, TELESCOPE] = COMMAND if extends else -COMMAND
    q[:, TELESCOPE] += v * (time - 0.5 * SECONDS)
    supply = np.full(count, circuit.supply_pressure - droop)
    return Heard(time, q, p_a, p_b, supply, command)


def off(heard: Heard, part: Part, error: float) -> Heard:
    """From ONSET on, the transducer shows an error [Pa] more."""
    name = "p_a" if part is Part.PRESSURE_A else "p_b"
    shown = getattr(heard, name).copy()
    shown[heard.time >= ONSET, TELESCOPE] += error
    return replace(heard, **{name: shown})


@pytest.mark.parametrize("part", [Part.PRESSURE_A, Part.PRESSURE_B])
@pytest.mark.parametrize("error", [2e5, 3e5, 6e5])
def test_a_transducer_that_hides_the_drop_by_which_a_piston_goes_is_found(
    model: Model, untrimmed: Tolerance, part: Part, error: float
) -> None:
    """It shows a chamber at the supply, or above: so no flow, and the piston goes."""
    watched = off(at_work(model, part, DROP), part, error).to(model, untrimmed)
    (finding,) = watched.monitor.findings
    assert (finding.part, finding.joint) == (part, "telescope")
    assert finding.found - ONSET < 1.0
    assert finding.size == pytest.approx(error, rel=0.05)


@pytest.mark.parametrize("part", [Part.PRESSURE_A, Part.PRESSURE_B])
@pytest.mark.parametrize(("drop", "error"), [(DROP, 0.0), (DROP, 5e4), (4e4, 5e4), (1e5, -5e4)])
def test_what_zeros_do_to_a_small_drop_is_no_fault(
    model: Model, untrimmed: Tolerance, part: Part, drop: float, error: float
) -> None:
    """However many times the flow that is."""
    assert off(at_work(model, part, drop), part, error).to(model, untrimmed).monitor.findings == []


@pytest.mark.parametrize("drop", [-8e5, -1e4, 0.0, 3e4, 2e5, 3e6])
@pytest.mark.parametrize("shown", [-2e5, 0.0, 4e5])
def test_the_way_tells_by_how_much_a_drop_is_off(drop: float, shown: float) -> None:
    """W is -2e-6."""
    missed = -2e-6 * (roots(np.array(drop)) - roots(np.array(shown)))
    off = error_of_drop(missed, np.array(-2e-6), np.array(shown))
    assert off == pytest.approx(shown - drop, abs=10.0)
    assert np.isnan(error_of_drop(missed, np.array(0.0), np.array(shown)))
