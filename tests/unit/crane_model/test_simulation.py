"""Forward simulation of the crane: energy, an independent integrator, and force from motion."""

from itertools import product

import numpy as np
import pinocchio as pin
import pytest
from laboratory_crane import PLANAR_JOINTS
from scipy.integrate import solve_ivp
from unit.crane_model.changed_machine import with_actuator
from unit.crane_model.lagrangian import energy
from unit.crane_model.pinocchio_crane import (
    dynamic_parameters,
    planar_crane,
    random_bodies,
    standard_from_pinocchio,
)

from crane_model import Model, RangeError, Record, Simulation, lever_arms, simulate
from crane_model.base_parameters import lagrangian_from_standard
from crane_model.cylinders import cylinder_forces_from_generalized
from crane_model.dynamics import Geometry

COULOMB = np.array([800.0, 300.0, 250.0])
ASYMMETRY = np.array([50.0, -30.0, 40.0])
VISCOUS = np.array([900.0, 400.0, 1500.0])
START = np.array([[0.5, -1.2, 0.4]]), np.array([[0.05, -0.2, 0.1]])


@pytest.fixture(scope="module")
def bodies() -> dict[str, pin.Inertia]:
    """Bodies of moderate offsets; telescope and gripper balanced about the telescope's axis."""
    bodies = random_bodies(3)
    for body in bodies.values():
        body.lever = np.array([0.1, 0.0, 0.2])
    bodies["TG"].lever = np.array([0.0, 0.0, 0.3])
    return bodies


@pytest.fixture(scope="module")
def nine(bodies: dict[str, pin.Inertia], geometry: Geometry) -> np.ndarray:
    to_nine = lagrangian_from_standard(geometry) @ standard_from_pinocchio()
    return to_nine @ dynamic_parameters(bodies)


def with_friction(
    crane: Model,
    nine: np.ndarray,
    *,
    coulomb: np.ndarray,
    asymmetry: np.ndarray,
    viscous: np.ndarray,
) -> Model:
    friction = np.stack([coulomb, asymmetry, viscous, 0.02 * viscous], axis=1)
    return crane.with_estimate(np.r_[nine[:8], friction.ravel()], np.zeros(20), "made up")


@pytest.fixture(scope="module")
def frictionless(crane: Model, nine: np.ndarray) -> Model:
    none = np.zeros(3)
    return with_friction(crane, nine, coulomb=none, asymmetry=none, viscous=none)


@pytest.fixture(scope="module")
def rough(crane: Model, nine: np.ndarray) -> Model:
    return with_friction(crane, nine, coulomb=COULOMB, asymmetry=ASYMMETRY, viscous=VISCOUS)


def drive(time: np.ndarray) -> np.ndarray:
    """(T, 1, 3) cylinder forces that push the crane about, through several reversals [N]."""
    forces = [
        20e3 + 15e3 * np.sin(6.0 * time),
        -3e3 + 8e3 * np.cos(5.0 * time),
        400.0 + 2e3 * np.sin(9.0 * time),
    ]
    return np.stack(forces, axis=1)[:, None]


def simulated(model: Model, steps: int, duration: float) -> Simulation:
    time = np.linspace(0.0, duration, steps + 1)
    return simulate(model, *START, drive(time), duration / steps, substeps=1)


def orders(errors: list[float]) -> np.ndarray:
    """Order of convergence between errors of steps halved each time."""
    return np.diff(-np.log2(errors))


def test_energy_is_kept_without_friction_to_second_order(
    frictionless: Model, nine: np.ndarray, geometry: Geometry
) -> None:
    """Eight cranes let fall: kinetic into potential energy and back."""
    rng = np.random.default_rng(15)
    q = rng.uniform([-0.3, -2.0, 0.3], [1.0, -0.5, 1.2], (8, 3))
    v = rng.uniform(-0.3, 0.3, (8, 3))
    drifts = []
    for steps in (25, 50, 100):
        motion = simulate(frictionless, q, v, np.zeros((steps + 1, 8, 3)), 0.5 / steps, substeps=1)
        flat = motion.position.reshape(-1, 3), motion.velocity.reshape(-1, 3)
        kinetic, potential = (e.reshape(-1, 8) for e in energy(geometry, nine, *flat))
        total = kinetic + potential
        assert np.ptp(kinetic, axis=0).min() > 100.0  # J: there is something to keep
        drifts.append(np.abs(total - total[0]).max())
    np.testing.assert_allclose(orders(drifts), 2.0, atol=0.3)
    assert drifts[-1] < 0.5


def test_smooth_crane_agrees_with_scipy_and_pinocchio(
    crane: Model, nine: np.ndarray, bodies: dict[str, pin.Inertia]
) -> None:
    """Articulated-body forward dynamics under an eighth-order Runge-Kutta method."""
    friction = {"coulomb": np.zeros(3), "asymmetry": ASYMMETRY, "viscous": VISCOUS}
    model = with_friction(crane, nine, **friction)
    planar = planar_crane(bodies)
    data, duration = planar.createData(), 0.5

    def state_rate(time: float, state: np.ndarray) -> np.ndarray:
        q, v = state[:3], state[3:]
        tau = drive(np.array([time]))[0, 0] * lever_arms(model.machine, q[None], model.joints)[0]
        tau = tau - ASYMMETRY - VISCOUS * v - 0.02 * VISCOUS * np.abs(v)
        return np.r_[v, pin.aba(planar, data, q, v, tau)]

    start = np.concatenate([part[0] for part in START])
    exact = solve_ivp(state_rate, (0, duration), start, method="DOP853", rtol=1e-10, atol=1e-12)
    errors = []
    for steps in (25, 50, 100):
        motion = simulated(model, steps, duration)
        end = np.r_[motion.position[-1, 0], motion.velocity[-1, 0]]
        errors.append(np.abs(end - exact.y[:, -1]).max())
    np.testing.assert_allclose(orders(errors), 2.0, atol=0.4)
    assert errors[-1] < 1e-3


def inverse_dynamics_residual(model: Model, motion: Simulation) -> tuple[np.ndarray, np.ndarray]:
    """Predicted minus driving force between instants, and whether each joint slid all the way."""
    q, v = motion.position[:, 0], motion.velocity[:, 0]
    record = Record(
        PLANAR_JOINTS,
        (motion.time[1:] + motion.time[:-1]) / 2,
        (q[1:] + q[:-1]) / 2,
        (v[1:] + v[:-1]) / 2,
        motion.acceleration[1:, 0],
    )
    force = (motion.force[1:, 0] + motion.force[:-1, 0]) / 2
    return model.predict(record) - force, v[1:] * v[:-1] > 0.0


def test_inverse_dynamics_of_the_motion_gives_the_force_back(rough: Model) -> None:
    errors = []
    for steps in (50, 100, 200):
        motion = simulated(rough, steps, 1.0)
        residual, sliding = inverse_dynamics_residual(rough, motion)
        assert 0.3 < sliding.mean() < 1.0  # the motion slides, and also reverses
        errors.append(np.sqrt((residual[sliding] ** 2).mean() / (motion.force**2).mean()))
    np.testing.assert_allclose(orders(errors), 2.0, atol=0.5)
    assert errors[-1] < 1e-3


def test_joint_that_is_held_carries_no_more_than_its_friction(rough: Model) -> None:
    """At standstill (13) is an interval: the rest of the force lies within +-f_c."""
    motion = simulated(rough, 200, 1.0)
    residual, _ = inverse_dynamics_residual(rough, motion)
    v = motion.velocity[:, 0]
    held = (v[1:] == 0.0) & (v[:-1] == 0.0)
    assert held.any()
    allowed = np.broadcast_to(COULOMB, residual.shape)[held]
    assert (np.abs(residual[held]) <= allowed * (1.0 + 1e-2)).all()


def test_motion_converges_through_reversals_to_first_order(rough: Model) -> None:
    """Errors fall with the step, for a joint that reverses does so at the end of a step."""
    rng = np.random.default_rng(17)
    q = rng.uniform([-0.3, -2.0, 0.3], [1.0, -0.5, 1.2], (12, 3))
    v = rng.uniform(-0.3, 0.3, (12, 3))

    def positions(steps: int) -> np.ndarray:
        forces = np.repeat(drive(np.linspace(0.0, 0.6, steps + 1)), 12, axis=1)
        return simulate(rough, q, v, forces, 0.6 / steps, substeps=1).position

    finest = positions(800)
    assert (np.diff(np.sign(np.diff(finest, axis=0)), axis=0) != 0.0).sum() > 12  # reversals
    errors = [
        np.sqrt(((positions(steps) - finest[:: 800 // steps]) ** 2).mean()) for steps in (25, 200)
    ]
    assert errors[1] < errors[0] / 6.0
    assert errors[1] < 1e-3


def load_of_friction(model: Model, q: np.ndarray, share: np.ndarray) -> np.ndarray:
    """Cylinder forces that leave `share` of breakaway friction to each standing joint (N, 3)."""
    still = np.zeros_like(q)
    record = Record(PLANAR_JOINTS, np.zeros(len(q)), q, still, still, direction_known=share)
    return cylinder_forces_from_generalized(model.machine, q, model.predict(record), model.joints)


def test_below_breakaway_the_crane_stands_exactly_still(rough: Model) -> None:
    """Every joint loaded to 99.9 % of its Coulomb friction, in all eight combinations of sign."""
    share = 0.999 * np.array(list(product([-1.0, 1.0], repeat=3)))
    q = np.tile(START[0], (8, 1))
    forces = np.tile(load_of_friction(rough, q, share), (40, 1, 1))
    motion = simulate(rough, q, np.zeros_like(q), forces, 0.005)
    assert (motion.velocity == 0.0).all()
    assert (motion.position == q).all()
    assert (motion.acceleration == 0.0).all()


@pytest.mark.parametrize("joint", range(3))
@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_above_breakaway_the_joint_moves_the_way_it_is_pushed(
    rough: Model, joint: int, sign: float
) -> None:
    share = np.zeros((1, 3))
    share[0, joint] = 1.05 * sign
    forces = np.tile(load_of_friction(rough, START[0], share), (10, 1, 1))
    motion = simulate(rough, START[0], np.zeros((1, 3)), forces, 0.005)
    moved = motion.position[-1, 0] - START[0][0]
    assert sign * moved[joint] > 0.0
    assert (np.delete(moved, joint) == 0.0).all()


def test_many_runs_are_each_like_one_alone(rough: Model) -> None:
    rng = np.random.default_rng(16)
    q = rng.uniform([-0.3, -2.0, 0.3], [1.0, -0.5, 1.2], (5, 3))
    v = rng.uniform(-0.3, 0.3, (5, 3))
    forces = drive(np.linspace(0.0, 0.2, 41)) + rng.normal(0.0, 500.0, (41, 5, 3))
    together = simulate(rough, q, v, forces, 0.005)
    assert together.position.shape == together.force.shape == (41, 5, 3)
    for n in range(5):
        alone = simulate(rough, q[n : n + 1], v[n : n + 1], forces[:, n : n + 1], 0.005)
        for name in ("position", "velocity", "acceleration", "force"):
            np.testing.assert_allclose(
                getattr(together, name)[:, n], getattr(alone, name)[:, 0], rtol=1e-9, atol=1e-9
            )


def test_reported_force_is_the_drive_times_the_lever_arm(rough: Model) -> None:
    motion = simulated(rough, 20, 0.2)
    lever = lever_arms(rough.machine, motion.position[:, 0], rough.joints)
    np.testing.assert_allclose(motion.force[:, 0], drive(motion.time)[:, 0] * lever, rtol=1e-12)


def test_drive_that_is_not_finite_is_refused(rough: Model) -> None:
    forces = np.zeros((3, 1, 3))
    forces[1, 0, 2] = np.nan
    with pytest.raises(RangeError, match="the drive has samples that are not finite"):
        simulate(rough, *START, forces, 0.005)


def test_motion_out_of_the_range_of_a_linkage_is_refused(rough: Model) -> None:
    """With a longer link the four-bar linkage comes apart when the outer boom folds out."""
    machine = with_actuator(rough.machine, "outer_boom", c2=0.36)
    short = Model("short", rough.setting._replace(machine=machine), rough.terms, rough.theta)
    q, v = np.array([[0.5, 0.0, 0.4]]), np.array([[0.0, 4.0, 0.0]])
    with pytest.raises(RangeError, match="outer_boom: the linkage cannot be assembled"):
        simulate(short, q, v, np.zeros((50, 1, 3)), 0.01)
