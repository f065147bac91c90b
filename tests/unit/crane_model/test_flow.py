"""The flow balance: true parameters of a cylinder that is integrated here, and their recovery.

The cylinder is simulated from the balance of each chamber with code of its own.
"""

import math

import numpy as np
import pytest

from crane_model import DataError, Machine, Record
from crane_model.flow import (
    FLOW_EFFECTS,
    InternalLeakage,
    OilCompressibility,
    Valve,
    asymmetry,
    by_chamber,
    flow_regressor,
    piston_flow,
)

JOINT = "telescope"  # x = q
SUPPLY, TANK, ATMOSPHERE = 175e5, 2e5, 1.013e5
GAINS = np.array([4.0e-7, 3.2e-7, 2.2e-7, 2.6e-7])  # supply_a, a_tank, supply_b, b_tank
BANDS = 0.08, 0.06  # where chamber A is fed, and where B is
PLAY = 0.02
WORN = 0.9  # m, where a piston that wears leaks most
LEAK, BETA, V_0 = 3e-12, 1.0e9, 3e-4
MASS, VISCOUS = 150.0, 4000.0


PERIOD, STEPS = 0.002, 4000


def command(time: float) -> float:
    return 0.35 * math.sin(1.3 * time) + 0.2 * math.sin(4.1 * time + 1.0)


def spool() -> list[float]:
    """Every half PERIOD; it follows its command by half the play."""
    at, track = command(0.0), []
    for k in range(2 * STEPS):
        u = command(k * PERIOD / 2)
        if abs(u - at) > PLAY / 2:
            at = u - math.copysign(PLAY / 2, u - at)
        track.append(at)
    return track


def root(drop: float) -> float:
    return math.copysign(math.sqrt(abs(drop)), drop)


def moved(machine: Machine, air: float = 0.0, wear: float = 0.0) -> Record:
    """8 s of a loaded mass on a cylinder with leakage and springy oil behind a valve with play,
    whose edges, and dead bands of the two directions, all differ; with a share of `air`, and with
    `wear` times more leakage about its mean place.
    """
    track = spool()
    cylinder = machine.cylinders[JOINT]

    def slope(time: float, state: np.ndarray) -> np.ndarray:
        x, v, p_a, p_b = state.tolist()
        u = track[round(2 * time / PERIOD)]
        up, down = max(0.0, u - BANDS[0]), max(0.0, -u - BANDS[1])
        q_a = GAINS[0] * up * root(SUPPLY - p_a) - GAINS[1] * down * root(p_a - TANK)
        q_b = GAINS[2] * down * root(SUPPLY - p_b) - GAINS[3] * up * root(p_b - TANK)
        leak = LEAK * (1.0 + wear * math.exp(-(((x - WORN) / 0.35) ** 2))) * (p_a - p_b)
        v_a = cylinder.area_a * (x - cylinder.length_min) + V_0
        v_b = cylinder.area_b * (cylinder.length_max - x) + V_0
        softer_a, softer_b = (
            1.0 + BETA * air * ATMOSPHERE / (p + ATMOSPHERE) ** 2 for p in (p_a, p_b)
        )
        force = cylinder.area_a * p_a - cylinder.area_b * p_b - 4000.0 * math.sin(0.9 * time)
        return np.array(
            [
                v,
                (force - VISCOUS * v) / MASS,
                BETA / v_a / softer_a * (q_a - leak - cylinder.area_a * v),
                BETA / v_b / softer_b * (q_b + leak + cylinder.area_b * v),
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
    """By such a valve."""
    return moved(machine)


def terms(*bands: float) -> tuple:
    """Of the balance, for a valve with these dead bands."""
    valve = Valve(joint=JOINT, dead_band_a=bands[0], dead_band_b=bands[1], play=PLAY)
    return valve, InternalLeakage(joint=JOINT), OilCompressibility(joint=JOINT)


def fit(terms: tuple, record: Record, machine: Machine) -> tuple[np.ndarray, float]:
    """Parameters by least squares, and the share of the flow that is left."""
    columns = flow_regressor(terms, record, machine).reshape(2 * len(record), -1)
    flow = piston_flow(record, machine, JOINT).ravel()
    scale = np.abs(columns).max(axis=0)
    values = np.linalg.lstsq(columns / scale, flow, rcond=None)[0] / scale
    return values, float(np.linalg.norm(flow - columns @ values) / np.linalg.norm(flow))


def test_true_parameters_come_back_from_the_balance(driven: Record, machine: Machine) -> None:
    """Each edge with its own gain."""
    values, left = fit(terms(*BANDS), driven, machine)
    assert left < 1e-3
    np.testing.assert_allclose(values, [*GAINS, LEAK, 1 / BETA, V_0 / BETA], rtol=0.01)


def test_each_dead_band_is_where_least_is_left(driven: Record, machine: Machine) -> None:
    for way in (0, 1):
        bands = [np.array(BANDS) + change * np.eye(2)[way] for change in (-0.02, 0.0, 0.02)]
        left = [fit(terms(*one), driven, machine)[1] for one in bands]
        assert left[1] < 0.5 * min(left[0], left[2])


def test_asymmetry_is_that_between_the_directions_not_between_the_chambers() -> None:
    assert asymmetry(np.array([3.0, 3.0, 2.0, 2.0])) == 0.0  # for a differential cylinder
    uneven = np.array([3.0 * 1.1, 3.0 * 0.9, 2.0 * 0.9, 2.0 * 1.1])
    assert asymmetry(uneven) == pytest.approx(0.1)
    assert asymmetry(uneven[::-1]) == pytest.approx(0.1)  # chambers exchanged
    mean, share = by_chamber(np.array([3.3, 2.7, 2.2, 1.8]))
    np.testing.assert_allclose(mean, [3.0, 2.0])
    np.testing.assert_allclose(share, [0.1, -0.1])


def test_the_play_is_where_least_is_left(driven: Record, machine: Machine) -> None:
    def left(play: float) -> float:
        valve, *others = terms(*BANDS)
        return fit((valve.model_copy(update={"play": play}), *others), driven, machine)[1]

    assert left(PLAY) < 0.5 * min(left(0.0), left(2 * PLAY))


@pytest.mark.parametrize("signal", ["command", "supply_pressure", "tank_pressure", "pressure_a"])
def test_without_its_signals_a_valve_is_not_observable(
    driven: Record, machine: Machine, signal: str
) -> None:
    kept = {name: getattr(driven, name) for name in driven.__dataclass_fields__} | {signal: None}
    with pytest.raises(DataError, match=f"flow term 'valve': needs {signal}, which was not rec"):
        Valve(joint=JOINT).columns(Record(**kept), machine)


def test_terms_of_two_joints_share_no_balance(driven: Record, machine: Machine) -> None:
    with pytest.raises(DataError, match="terms of one joint, got outer_boom, telescope"):
        flow_regressor((Valve(joint=JOINT), Valve(joint="outer_boom")), driven, machine)
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
        supplied = Valve(joint=joint).columns(record, machine)[0].sum(axis=1)
        np.testing.assert_array_equal(np.sign(swept), np.sign(supplied))


def test_effects_of_the_flow_are_confusable_both_ways() -> None:
    for name, (effect, _, _) in FLOW_EFFECTS.items():
        for other in effect.confusable:
            assert name in FLOW_EFFECTS[other].effect.confusable
