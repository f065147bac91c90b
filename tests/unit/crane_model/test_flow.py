"""The flow balance: parameters planted in a cylinder that is integrated here, and their recovery.

The cylinder is simulated from the balance of each chamber with code of its own.
"""

import math

import numpy as np
import pytest

from crane_model.errors import DataError
from crane_model.flow import FLOW_REGISTRY, flow_candidates, flow_regressor, piston_flow
from crane_model.flow.oil import InternalLeakage, OilCompressibility
from crane_model.flow.valve import Valve, ValveAsymmetry, ValveDeadZone, ValveHysteresis
from crane_model.machine import Machine
from crane_model.record import Record

JOINT = "telescope"  # x = q
SUPPLY, TANK = 175e5, 2e5
K, DK, BAND, LEAK, BETA, V_0 = 3e-7, 4e-8, 0.08, 3e-12, 1.0e9, 3e-4
MASS, VISCOUS = 150.0, 4000.0


PERIOD, STEPS = 0.002, 4000


def command(time: float) -> float:
    return 0.35 * math.sin(1.3 * time) + 0.2 * math.sin(4.1 * time + 1.0)


def root(drop: float) -> float:
    return math.copysign(math.sqrt(abs(drop)), drop)


def moved(machine: Machine, band: float, dk: float) -> Record:
    """8 s of a loaded mass on a cylinder with leakage and springy oil behind a valve."""
    cylinder = machine.cylinders[JOINT]

    def slope(time: float, state: np.ndarray) -> np.ndarray:
        x, v, p_a, p_b = state.tolist()
        u = command(time)
        u = math.copysign(max(0.0, abs(u) - band), u)
        if u > 0.0:
            q_a, q_b = (K + dk) * u * root(SUPPLY - p_a), -(K + dk) * u * root(p_b - TANK)
        else:
            q_a, q_b = (K - dk) * u * root(p_a - TANK), -(K - dk) * u * root(SUPPLY - p_b)
        leak = LEAK * (p_a - p_b)
        v_a = cylinder.area_a * (x - cylinder.length_min) + V_0
        v_b = cylinder.area_b * (cylinder.length_max - x) + V_0
        force = cylinder.area_a * p_a - cylinder.area_b * p_b - 4000.0 * math.sin(0.9 * time)
        return np.array(
            [
                v,
                (force - VISCOUS * v) / MASS,
                BETA / v_a * (q_a - leak - cylinder.area_a * v),
                BETA / v_b * (q_b + leak + cylinder.area_b * v),
            ]
        )

    states = [np.array([0.7, 0.0, 40e5, 65e5])]
    for k in range(STEPS - 1):  # Runge-Kutta of second order, in the middle of each step
        middle = states[-1] + PERIOD / 2 * slope(k * PERIOD, states[-1])
        states.append(states[-1] + PERIOD * slope((k + 0.5) * PERIOD, middle))
    x, v, p_a, p_b = np.array(states).T
    time = PERIOD * np.arange(STEPS)
    zero = np.zeros_like(time)
    return Record(
        (JOINT,),
        time,
        x[:, None],
        v[:, None],
        zero[:, None],
        pressure_a=p_a[:, None],
        pressure_b=p_b[:, None],
        command=np.array([[command(t)] for t in time]),
        supply_pressure=SUPPLY + zero,
        tank_pressure=TANK + zero,
    )


@pytest.fixture(scope="module")
def driven(machine: Machine) -> Record:
    """By a valve with a dead zone."""
    return moved(machine, BAND, 0.0)


TERMS = (
    Valve(joint=JOINT),
    InternalLeakage(joint=JOINT),
    OilCompressibility(joint=JOINT),
)


def fit(terms: tuple, record: Record, machine: Machine) -> tuple[np.ndarray, float]:
    """Parameters by least squares, and the share of the flow that is left."""
    columns = flow_regressor(terms, record, machine).reshape(2 * len(record), -1)
    flow = piston_flow(record, machine, JOINT).ravel()
    scale = np.abs(columns).max(axis=0)
    values = np.linalg.lstsq(columns / scale, flow, rcond=None)[0] / scale
    return values, float(np.linalg.norm(flow - columns @ values) / np.linalg.norm(flow))


def test_planted_parameters_come_back_from_the_balance(driven: Record, machine: Machine) -> None:
    """The term of a dead zone stands beside that of the valve; for its band K_d = K."""
    values, left = fit((*TERMS, ValveDeadZone(joint=JOINT, band=BAND)), driven, machine)
    assert left < 1e-3
    np.testing.assert_allclose(values, [K, LEAK, 1 / BETA, V_0 / BETA, K], rtol=0.01)


def test_planted_asymmetry_of_the_gain_comes_back(machine: Machine) -> None:
    values, left = fit((*TERMS, ValveAsymmetry(joint=JOINT)), moved(machine, 0.0, DK), machine)
    assert left < 1e-3
    np.testing.assert_allclose(values, [K, LEAK, 1 / BETA, V_0 / BETA, DK], rtol=0.01)


def test_the_band_of_the_dead_zone_is_where_least_is_left(driven: Record, machine: Machine) -> None:
    bands = [0.04, 0.06, BAND, 0.10, 0.12]
    left = [fit((*TERMS, ValveDeadZone(joint=JOINT, band=b)), driven, machine)[1] for b in bands]
    assert bands[int(np.argmin(left))] == BAND
    assert fit(TERMS, driven, machine)[1] > 2.0 * min(left)


def test_hysteresis_is_the_play_of_the_spool(driven: Record, machine: Machine) -> None:
    """Rising command: the spool is half the width behind; falling: half the width ahead."""
    width = 0.04
    term, valve = ValveHysteresis(joint=JOINT, width=width), Valve(joint=JOINT)
    u = driven.command[:, 0]
    flow = (term.columns(driven, machine) + valve.columns(driven, machine))[:, 0, 0]
    drop = np.where(flow > 0.0, SUPPLY - driven.pressure_a[:, 0], driven.pressure_a[:, 0] - TANK)
    spool = flow / np.sqrt(drop)
    rising = np.flatnonzero(np.diff(u) > 0.0)[1:]
    falling = np.flatnonzero(np.diff(u) < 0.0)[1:]
    behind = u - spool
    assert np.abs(behind).max() == pytest.approx(width / 2)
    # once the play is taken up: the rest of each stroke, of which there are a handful
    assert np.isclose(behind[rising], width / 2).mean() > 0.7
    assert np.isclose(behind[falling], -width / 2).mean() > 0.7
    stands = ~np.isclose(np.abs(behind), width / 2)
    moved = np.abs(np.diff(spool))[stands[1:] & stands[:-1]]
    assert len(moved) > 100
    np.testing.assert_allclose(moved, 0.0, atol=1e-12)


@pytest.mark.parametrize("signal", ["command", "supply_pressure", "tank_pressure", "pressure_a"])
def test_without_its_signals_a_valve_is_not_observable(
    driven: Record, machine: Machine, signal: str
) -> None:
    kept = {name: getattr(driven, name) for name in driven.__dataclass_fields__} | {signal: None}
    with pytest.raises(DataError, match=f"flow term 'valve': needs {signal}, which was not rec"):
        Valve(joint=JOINT).columns(Record(**kept), machine)


def test_terms_of_two_joints_share_no_balance(driven: Record, machine: Machine) -> None:
    with pytest.raises(DataError, match="terms of one joint, got outer_boom, telescope"):
        flow_regressor((TERMS[0], Valve(joint="outer_boom")), driven, machine)
    with pytest.raises(DataError, match="no term at all"):
        flow_regressor((), driven, machine)


def test_flow_is_positive_into_chamber_a_whichever_way_the_joint_turns(machine: Machine) -> None:
    """A command moves the joint its positive way; where extending lowers q, chamber B is fed."""
    one = np.ones((1, 3))
    q = np.array([[0.5, -1.2, 0.4]])
    joints = ("inner_boom", "outer_boom", "telescope")
    record = Record(
        joints,
        np.zeros(1),
        q,
        one,
        0 * one,
        pressure_a=50e5 * one,
        pressure_b=50e5 * one,
        command=one,
        supply_pressure=SUPPLY * np.ones(1),
        tank_pressure=TANK * np.ones(1),
    )
    for joint in joints:
        swept = piston_flow(record, machine, joint)[0]
        supplied = Valve(joint=joint).columns(record, machine)[0, :, 0]
        np.testing.assert_array_equal(np.sign(swept), np.sign(supplied))


def test_candidates_of_the_flow_are_described_and_confusable_both_ways() -> None:
    for cls in flow_candidates():
        assert cls.effect is not None
        name = cls.model_fields["type"].default
        assert FLOW_REGISTRY[name] is cls
        for other in cls.effect.confusable:
            back = FLOW_REGISTRY[other].effect
            assert back is not None
            assert name in back.confusable
    assert Valve not in flow_candidates()
