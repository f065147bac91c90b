"""`predictive_flow`: margins of its loop against simulated loops, and what it does with a joint."""

import numpy as np
import pytest

from crane_sim import Plant
from crane_sim.parts.parameters import load_both
from crane_sim.true_values import hydraulics_of
from crane_trajectory.control.dead_time import (
    LEAST_MARGINS,
    PredictorGains,
    margins,
    predictor_gains,
)
from crane_trajectory.control.valves_and_oil import edges, speed_at_margin

STEP_S = 0.005


def left_over(gains: PredictorGains, lag: float, late: float, gain: float) -> float:
    """How far a joint swings in the end that begins 1 rad off: it integrates `gain` times the speed
    asked for, `late` s late, and its controller believes in 1 and in `lag`.
    """
    count, known, true = int(40.0 / STEP_S), round(lag / STEP_S), round(late / STEP_S)
    sent, course = np.zeros(count), np.ones(count)
    q0, d = 1.0, 0.0
    for k in range(1, count):
        course[k] = course[k - 1] + STEP_S * gain * (sent[k - true] if k >= true else 0.0)
        off = course[k] - q0
        q0 += STEP_S * ((sent[k - known] if k >= known else 0.0) + d + gains.l1 * off)
        d += STEP_S * gains.l2 * off
        ahead = q0 + STEP_S * sent[max(0, k - known) : k].sum() + lag * d
        sent[k] = -gains.kv * ahead - d
    return float(np.abs(course[-count // 4 :]).max())


@pytest.mark.parametrize("lag", [0.15, 0.4])
def test_loops_swing_beyond_their_margins_and_settle_within(lag: float) -> None:
    gains = predictor_gains(lag)
    found = margins(gains, lag)
    assert left_over(gains, lag, lag, 0.85 * found.gain) < 0.1
    assert left_over(gains, lag, lag, 1.15 * found.gain) > 1.0
    assert left_over(gains, lag, lag + 0.85 * found.delay, 1.0) < 0.2
    assert left_over(gains, lag, lag + 1.15 * found.delay, 1.0) > 1.0


@pytest.mark.parametrize("lag", [0.0, 0.03, 0.1, 0.2, 0.4, 0.6])
def test_every_lag_gets_gains_with_the_margins_that_are_wanted(lag: float) -> None:
    gains = predictor_gains(lag)
    gain, phase, delay = margins(gains, max(lag, 0.02))
    assert gain >= LEAST_MARGINS[0] and phase >= LEAST_MARGINS[1]
    assert delay >= LEAST_MARGINS[2] * lag
    assert gains.kv * lag < 1.0


def test_a_loop_that_is_unstable_has_no_margins() -> None:
    assert margins(PredictorGains(10.0, 200.0, 1e4), 0.4).gain <= 1.1


@pytest.mark.parametrize("direction", [1.0, -1.0])
def test_a_load_that_drives_is_held_by_the_edge_that_returns(direction: float) -> None:
    """The swing of the simulated excavator, after its valve has half closed: its inertia empties
    the fed chamber. In the end friction is the load, and the edge that feeds sets the speed.
    """
    machine, simulated = load_both("field_excavator", None)
    plant = Plant(simulated, machine, simulated.start, running=1e5)
    actuator, known = machine.cylinders["swing"], hydraulics_of(simulated, machine, "swing")
    names = ("supply_a", "a_tank", "supply_b", "b_tank")
    areas = {"area_a": actuator.area_a, "area_b": actuator.area_b}
    fields = areas | {name: known[name] for name in names}
    fields["tank_pressure"] = plant.tank_pressure
    valve = np.rec.array(
        [tuple(fields.values())], dtype=[(name, float) for name in fields]
    )[0]  # fmt: skip
    lever = machine.cylinder("swing", plant.q[:1])[0, 1]
    extends = direction * lever > 0.0
    dead_band, ratios = known["dead_band_a"], []
    for k in range(400):
        command = 0.7 if k < 150 else 0.3
        plant.advance(np.array([direction * command, 0.0, 0.0, 0.0]), 0.02)
        if 170 <= k < 205 or k >= 350:  # the spool rests
            load = actuator.area_a * plant.pressure_a[0] - actuator.area_b * plant.pressure_b[0]
            drop = plant.supply_pressure - (plant.pressure_a if extends else plant.pressure_b)[0]
            speed = speed_at_margin(valve, extends, *edges(valve, extends), load, drop)
            opening = (abs(plant.spool[0]) - dead_band) / (1.0 - dead_band)
            ratios.append(opening * speed / abs(lever * plant.v[0]))
    np.testing.assert_allclose(ratios, 1.0, atol=0.07)  # the compensator takes 4 %
