"""The parts of the position estimator against others: numeric slopes, filterpy, orifices."""

import numpy as np
import pytest
from filterpy.kalman import KalmanFilter
from unit.crane_model.test_hydraulics import crane

from crane_model import Record, generalized_forces
from crane_model.dynamics import Geometry, lagrangian_regressor
from crane_model.hydraulics.simulation import circuit_of
from crane_model.terms.gravity_and_load import tip_mass
from crane_observer.position.balance import LoadedMechanics
from crane_observer.position.filter import Observability
from crane_observer.position.flow import (
    FLOW_SUMS,
    SPOOL,
    Commands,
    add_interval,
    spools_of,
)
from crane_observer.position.state import (
    FlowWindow,
    Pair,
    StateLayout,
    Trust,
    carry,
    correct,
    relax,
)

Q, V, A = np.array([[0.4, -1.3, 0.5]]), np.array([[0.1, -0.05, 0.2]]), np.array([[0.2, 0.1, -0.1]])


def predicted(q: np.ndarray, v: np.ndarray, a: np.ndarray) -> np.ndarray:
    model = crane()
    return model.predict(Record(model.joints, np.zeros(1), q, v, a))[0]


def test_the_balance_is_that_of_the_model_with_a_mass_at_its_tip() -> None:
    model = crane()
    found = LoadedMechanics.of(model).balance(Q, V, A)
    sum_of_parts = found.smooth + np.sign(V) * found.dry
    np.testing.assert_allclose(sum_of_parts[0], predicted(Q, V, A), rtol=1e-9)
    # a mass of 1 kg at the tip, by the term of the model that knows the planar crane
    regressor = lagrangian_regressor(Geometry.of(model.machine), Q, V, A)
    np.testing.assert_allclose(found.load, regressor @ tip_mass(model.machine), rtol=1e-9)


@pytest.mark.parametrize("j", range(3))
def test_slopes_of_the_balance_are_differences(j: int) -> None:
    mechanics, step = LoadedMechanics.of(crane()), np.eye(3)[[j]] * 1e-3
    low, high = (mechanics.balance(Q + sign * step, V, A) for sign in (-1.0, 1.0))
    found = mechanics.balance(Q, V, A)
    np.testing.assert_allclose(
        found.slope[0, :, j], (high.smooth - low.smooth)[0] / 2e-3, rtol=2e-3, atol=1.0
    )
    np.testing.assert_allclose(
        found.load_slope[0, :, j], (high.load - low.load)[0] / 2e-3, rtol=2e-3, atol=0.01
    )


def test_a_linear_case_is_that_of_filterpy() -> None:
    rng = np.random.default_rng(0)
    n = 6
    oracle = KalmanFilter(n, 2)
    root = rng.normal(size=(n, n))
    oracle.P, oracle.x = root @ root.T, rng.normal(size=(n, 1))
    x, P = oracle.x[:, 0].copy(), oracle.P.copy()
    for _ in range(20):
        decay, added = rng.uniform(0.9, 1.0, n), rng.uniform(0.0, 0.1, n)
        relax(x, P, decay, added)
        oracle.F, oracle.Q = np.diag(decay), np.diag(added)
        oracle.predict()
        slopes = np.zeros((2, n))
        slopes[:, 2:] = rng.normal(size=(2, n - 2))
        slopes[[0, 1], [0, 1]] = rng.uniform(0.8, 1.2, 2)
        oracle.F, oracle.Q = np.eye(n), np.zeros((n, n))
        oracle.F[:2] = slopes
        carry(P, np.arange(2), slopes)
        x[:2] = slopes @ x
        oracle.predict()
        H, z, R = rng.normal(size=(2, n)), rng.normal(size=2), rng.uniform(0.1, 1.0, 2)
        correct(x, P, H, z - H @ x, R, n)
        oracle.update(z[:, np.newaxis], np.diag(R), H)
    np.testing.assert_allclose(x, oracle.x[:, 0], rtol=1e-7)
    np.testing.assert_allclose(P, oracle.P, rtol=1e-6, atol=1e-10)


def test_a_measurement_of_infinite_variance_says_nothing() -> None:
    x, P = np.ones(2), np.eye(2)
    correct(x, P, np.eye(2), np.array([5.0, np.nan]), np.array([1.0, np.inf]), 2)
    np.testing.assert_allclose(x, [3.5, 1.0])
    np.testing.assert_allclose(P, np.diag([0.5, 1.0]))


def test_steady_flow_is_that_of_the_orifices() -> None:
    model = crane()
    circuit, spools = circuit_of(model), spools_of(model)
    commands, spool, sums = Commands.none(3), np.zeros(3, SPOOL), np.zeros(3, FLOW_SUMS)
    commands.add(0.0, np.full(3, 0.5))
    p = np.array([[9e6] * 3, [4e6] * 3])
    add_interval(circuit, spools, commands, spool, 0.0, 0.0, 1.0, p, p, 17e6, 25e6, sums)
    sums[:] = 0.0  # the spool has settled
    add_interval(circuit, spools, commands, spool, 1.0, 1.0, 1.1, p, p, 17e6, 25e6, sums)
    for j, sense in enumerate(spools.sense):
        z = sense * 0.5 - sense * 0.005  # it trails by half the hysteresis
        dead = 0.05 if sense > 0 else 0.06
        o = (abs(z) - dead) / (1.0 - dead)
        tank = circuit.tank_pressure
        into_a = 17e6 - 9e6 if sense > 0 else -(9e6 - tank)
        into_b = -(4e6 - tank) if sense > 0 else 17e6 - 4e6
        for chamber, drop in enumerate((into_a, into_b)):
            wanted = 0.1 * 3e-7 * o * np.sign(drop) * np.sqrt(abs(drop))
            assert sums["flow"][j, chamber] == pytest.approx(wanted, rel=1e-3)
    force = generalized_forces(model.machine, Q, p[:1], p[1:], model.joints)[0]
    lever = LoadedMechanics.of(model).cylinders(Q)[0][:, 1]
    np.testing.assert_allclose(lever * sums["impulse"] / 0.1, force, rtol=1e-9)


def test_short_windows_make_the_pair_that_long_ones_are() -> None:
    """Of a piston whose force and speed change all the time."""
    model, rng = crane(), np.random.default_rng(3)
    circuit, spools = circuit_of(model), spools_of(model)
    pressures, speeds = rng.uniform(2e6, 1e7, (5, 2, 3)), rng.uniform(-0.1, 0.1, (4, 3))

    def windows(parts: list[range]) -> list[tuple[FlowWindow, np.ndarray]]:
        found, commands, spool = [], Commands.none(3), np.zeros(3, SPOOL)
        commands.add(0.0, np.full(3, 0.5))
        for part in parts:
            sums, begin, end = np.zeros(3, FLOW_SUMS), part[0], part[-1] + 1
            for k in part:
                add_interval(
                    circuit, spools, commands, spool, 0.05 * begin, 0.05 * k, 0.05 * (k + 1),
                    pressures[k], pressures[k + 1], 17e6, 25e6, sums,
                )  # fmt: skip
            window = FlowWindow(
                0.05 * end, 0.05 * len(part), sums, pressures[begin], pressures[end],
                np.zeros(3), np.zeros(3), True,
            )  # fmt: skip
            found.append((window, speeds[list(part)].mean(axis=0)))
        return found

    short = Pair.of(windows([range(k, k + 1) for k in range(4)]))
    long = Pair.of(windows([range(2), range(2, 4)]))
    for name in ("force", "velocity", "acceleration", "duration", "opened"):
        np.testing.assert_allclose(getattr(short, name), getattr(long, name), rtol=1e-9)
    assert (short.steps, long.steps) == (2, 1)
    for joined, whole in ((short.first, long.first), (short.second, long.second)):
        for name in ("time", "duration", "before", "after"):
            np.testing.assert_allclose(getattr(joined, name), getattr(whole, name))


def test_what_forces_do_not_bound_is_not_observable() -> None:
    """A pose that forces tell of two joints alone; as they forget, they tell of none."""
    layout, span = StateLayout.of(3), np.array([1.8, 2.6, 1.5])
    watched = Observability(layout, span, Trust().spread(layout), Trust().unknown)
    assert not watched.observable.any()
    rows = np.zeros((2, layout.size))
    rows[[0, 1], [0, 1]] = 1000.0  # of unit variance: 1 mrad each
    for _ in range(20):
        watched.add(rows, 0.05)
    assert watched.observable.tolist() == [True, True, False]
    assert watched.deviation[2] == pytest.approx(span[2])
    watched.add(rows[:0], 1e4)
    assert not watched.observable.any()
    assert layout.position == slice(0, 3)
