"""Terms with memory: what they remember, that they dissipate, and oscillators against scipy."""

from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from crane_model import Model, Record, simulate
from crane_model.terms import Setting
from crane_model.terms.elasticity import BoomFlexibility, relative_acceleration, swung_along
from crane_model.terms.friction import Coulomb
from crane_model.terms.presliding import SHARES, Backlash, MaxwellSlip, Presliding, Stiction
from crane_model.terms.single_axis import Inertia

AXIS = Setting({"axis": "m"}, None)
HYSTERESIS = (MaxwellSlip(joint="axis", travel=0.01), Presliding(joint="axis", travel=0.01))


def along(q: np.ndarray, time: np.ndarray, force: np.ndarray | None = None) -> Record:
    v = np.gradient(q, time)
    load = None if force is None else force[:, None]
    return Record(("axis",), time, q[:, None], v[:, None], 0 * v[:, None], force=load)


@pytest.mark.parametrize("term", HYSTERESIS, ids=lambda term: term.type)
def test_hysteresis_depends_on_the_way_and_not_on_the_time(term) -> None:
    q = 0.02 * np.sin(np.linspace(0.0, 20.0, 2000)) * np.linspace(0.1, 1.0, 2000)
    even = np.linspace(0.0, 10.0, 2000)
    uneven = np.cumsum(np.random.default_rng(1).uniform(0.001, 0.1, 2000))
    slow, fast = (term.columns(along(q, time), AXIS) for time in (even, uneven))
    np.testing.assert_array_equal(slow, fast)


@pytest.mark.parametrize("term", HYSTERESIS, ids=lambda term: term.type)
def test_hysteresis_takes_energy_out_of_every_cycle(term) -> None:
    """The work of each element over closed strokes of any length is positive."""
    phase = np.linspace(0.0, 6 * np.pi, 6001)
    for stroke in (1e-4, 2e-3, 0.02, 0.1):
        q = stroke * np.sin(phase)
        columns = term.columns(along(q, phase), AXIS)[:, 0]
        cycle = slice(4000, 6001)  # after the run-in
        middle = (columns[1:] + columns[:-1]) / 2
        work = (middle * np.diff(q)[:, None])[cycle].sum(axis=0)
        assert (work > -1e-12 * stroke).all()
        assert work.sum() > 0.0
        assert np.abs(columns).max() <= 1.0


def test_maxwell_slip_remembers_the_turning_point_of_a_nested_loop() -> None:
    """A small loop within a large one closes where it began (Masing, Madelung)."""
    term = MaxwellSlip(joint="axis", travel=0.01)
    path = [0.0, 0.05, 0.0, 0.012, 0.006, 0.012, 0.05]
    q = np.concatenate([np.linspace(a, b, 400) for a, b in pairwise(path)])
    columns = term.columns(along(q, np.arange(len(q)) * 0.01), AXIS)[:, 0]
    np.testing.assert_allclose(columns[4 * 400 - 401], columns[5 * 400 - 1], atol=1e-12)
    assert np.ptp(columns[3 * 400 : 5 * 400], axis=0).max() > 0.1


def test_maxwell_slip_gives_way_element_by_element() -> None:
    """From rest z_i = q/d_i up to 1: stiffness falls whenever one slips."""
    q = np.linspace(0.0, 0.02, 500)
    columns = MaxwellSlip(joint="axis", travel=0.01).columns(along(q, q), AXIS)[:, 0]
    np.testing.assert_allclose(columns, np.minimum(1.0, q[:, None] / (0.01 * SHARES)), atol=1e-12)


def test_backlash_acts_after_the_load_reverses_and_over_its_clearance_only() -> None:
    """The speed reverses ten times under one load, and then the load once."""
    clearance = 0.004
    q = np.concatenate([0.01 * np.sin(np.linspace(0, 20 * np.pi, 2000)), np.linspace(0, 0.02, 400)])
    load = np.where(np.arange(2400) < 2000, 500.0, -500.0)
    time = np.arange(2400) * 0.01
    column = Backlash(joint="axis", clearance=clearance).columns(along(q, time, load), AXIS)
    column = column[:, 0, 0]
    assert not column[:2000].any()
    assert column[2001] == pytest.approx(1.0, abs=0.05)  # on the new side, -1, force is missing
    way = q[2000:] - q[1999]
    np.testing.assert_allclose(column[2000:], np.maximum(0.0, 1.0 - way / clearance), atol=1e-12)
    slower = Backlash(joint="axis", clearance=clearance).columns(along(q, 3 * time, load), AXIS)
    np.testing.assert_array_equal(slower[:, 0, 0], column)


def test_stiction_grows_at_rest_and_gives_way_over_its_travel() -> None:
    dwell, travel = 0.5, 0.01
    q = np.concatenate([np.linspace(0, 0.2, 201), np.full(200, 0.2), np.linspace(0.2, 0.3, 401)])
    time = np.arange(len(q)) * 0.01
    v = np.diff(q, append=q[-1])[:, None] / 0.01
    record = Record(("axis",), time, q[:, None], v, 0 * v)
    term = Stiction(joint="axis", travel=travel, dwell=dwell)
    level = term.trace(record, AXIS)[:, 0]
    assert level[0] == 1.0  # it has stood before
    assert level[200] == pytest.approx(np.exp(-0.2 / travel))
    assert level[400] == pytest.approx(1.0 - np.exp(-2.0 / dwell), abs=1e-2)
    assert level[-1] == pytest.approx(level[400] * np.exp(-0.1 / travel), rel=0.1)
    column = term.columns(record, AXIS)[:, 0, 0]
    assert not column[201:400].any()  # at rest the direction is not known
    assert column[1:20].min() > 0.1


def test_a_block_breaks_away_above_its_stiction_and_keeps_sliding_below() -> None:
    """Held at 1.4 f_c, free at 1.6 f_c, and then it slides on at 1.2 f_c."""
    coulomb = 30.0
    terms = (
        Inertia(joint="axis"),
        Coulomb(joint="axis"),
        Stiction(joint="axis", travel=1e-3, dwell=1.0),
    )
    model = Model("block", AXIS, terms, np.array([12.0, coulomb, 0.5 * coulomb]))
    drive = coulomb * np.repeat([1.4, 1.6, 1.2], 100)[:, None, None]
    motion = simulate(model, np.zeros((1, 1)), np.zeros((1, 1)), drive, 0.01)
    v = motion.velocity[:, 0, 0]
    assert not v[:100].any()
    assert v[199] > 0.0
    assert (np.diff(v[201:]) > 0.0).all()


def test_an_oscillator_agrees_with_scipy() -> None:
    frequency, damping = 1.7, 0.08
    w = 2 * np.pi * frequency
    time = np.linspace(0.0, 4.0, 1601)

    def velocity(t: np.ndarray) -> np.ndarray:
        return 0.2 * np.sin(2.0 * t) + 0.05 * np.sin(11.0 * t)

    def push(t: float) -> float:
        return 0.4 * np.cos(2.0 * t) + 0.55 * np.cos(11.0 * t)

    exact = solve_ivp(
        lambda t, y: [y[1], -push(t) - 2 * damping * w * y[1] - w**2 * y[0]],
        (0.0, 4.0),
        [0.0, 0.0],
        t_eval=time,
        rtol=1e-9,
        atol=1e-12,
    ).y.T
    first = np.zeros(len(time), dtype=bool)
    first[0] = True
    states = swung_along(velocity(time), time, first, frequency, damping)
    np.testing.assert_allclose(states, exact, atol=1e-3 * np.abs(exact).max())
    along_it = relative_acceleration(states, push(time), frequency, damping)
    by_differences = np.gradient(exact[:, 1], time)
    np.testing.assert_allclose(along_it[1:-1], by_differences[1:-1], atol=0.01)


def test_a_flexible_boom_is_two_masses_and_a_spring() -> None:
    """Integrated by scipy in absolute coordinates, started by a blow; then it rings by itself."""
    whole, part, frequency, damping = 12.0, 4.0, 2.0, 0.05
    w = 2 * np.pi * frequency
    stiffness, loss = part * w**2, 2 * damping * part * w
    time = np.linspace(0.0, 2.0, 401)
    drive = np.where(time < 0.5, 30.0, 0.0)

    def slope(t: float, y: np.ndarray) -> list[float]:
        joint, v, tip, u = y
        spring = stiffness * (tip - joint) + loss * (u - v)
        force = np.interp(t, time, drive)
        return [v, (force + spring) / (whole - part), u, -spring / part]

    exact = solve_ivp(slope, (0, 2), [0.0] * 4, t_eval=time, rtol=1e-9, atol=1e-12, max_step=0.005)
    boom = BoomFlexibility(joint="axis", frequency=frequency, damping=damping)
    model = Model("boom", AXIS, (Inertia(joint="axis"), boom), np.array([whole, part]))
    motion = simulate(model, np.zeros((1, 1)), np.zeros((1, 1)), drive[:, None, None], 0.005)
    v = motion.velocity[:, 0, 0]
    np.testing.assert_allclose(v, exact.y[1], atol=0.01 * np.abs(exact.y[1]).max())
    assert np.ptp(exact.y[1][200:]) > 0.05 * np.abs(exact.y[1]).max()  # it does ring
