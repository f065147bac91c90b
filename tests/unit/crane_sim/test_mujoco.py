"""The simulated rigid bodies and the true parameters against MuJoCo, which derives its own."""

from typing import NamedTuple

import mujoco
import numpy as np
import pytest
from unit.crane_sim.injected_machine import inverse_dynamics

from crane_model import Machine, load_machine
from crane_model.dynamics import Geometry, fill_base_regressor
from crane_model.kinematics import link_transforms
from crane_sim import SimulatedCrane
from crane_sim.parts.constants import pack_chain
from crane_sim.parts.mujoco_model import machine_spec
from crane_sim.parts.rigid_bodies import mass_and_bias
from crane_sim.true_values import true_parameters

STATES = 1000
JOINTS = load_machine().joint_names
PLANAR = [1, 2, 3]


class States(NamedTuple):
    """(n, 4) each, in the order of JOINTS."""

    q: np.ndarray
    v: np.ndarray
    a: np.ndarray


@pytest.fixture(scope="module")
def model(simulated: SimulatedCrane, machine: Machine) -> mujoco.MjModel:
    return machine_spec(simulated, machine).compile()


@pytest.fixture(scope="module")
def states(machine: Machine) -> States:
    """Positions over all of Table 2; velocities and accelerations far beyond, so that all shows."""
    rng = np.random.default_rng(20)
    limits = [machine.limits[joint] for joint in JOINTS]
    low, high = ([getattr(row, f"position_{end}") for row in limits] for end in ("min", "max"))
    q = rng.uniform(low, high, (STATES, len(JOINTS)))
    return States(q, rng.normal(0.0, 1.5, q.shape), rng.normal(0.0, 3.0, q.shape))


def inverse_by_mujoco(model: mujoco.MjModel, states: States) -> np.ndarray:
    """(n, 4) generalized forces."""
    data, forces = mujoco.MjData(model), np.empty_like(states.q)
    for k, (data.qpos[:], data.qvel[:], data.qacc[:]) in enumerate(zip(*states, strict=True)):
        mujoco.mj_inverse(model, data)
        forces[k] = data.qfrc_inverse
    return forces


def assert_close(ours: np.ndarray, theirs: np.ndarray, relative: float) -> None:
    """Each element to `relative`; of elements that cancel to nothing, to the state's largest."""
    scale = np.abs(theirs).max(axis=tuple(range(1, theirs.ndim)), keepdims=True)
    assert (np.abs(ours - theirs) <= relative * (np.abs(theirs) + 1e-4 * scale)).all()


def test_coordinates_are_those_of_mujoco(model: mujoco.MjModel) -> None:
    names = [mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_JOINT, i) for i in range(model.njnt)]
    assert names == list(JOINTS)
    assert model.nq == model.nv == len(JOINTS)


def test_boom_tip(model: mujoco.MjModel, machine: Machine, states: States) -> None:
    data = mujoco.MjData(model)
    tips = link_transforms(machine, states.q[:50])[:, 3, :3, 3]
    for q, tip in zip(states.q, tips, strict=False):
        data.qpos[:] = q
        mujoco.mj_kinematics(model, data)
        np.testing.assert_allclose(data.body("telescope link").xpos, tip, atol=1e-12)


def test_mass_matrix_and_bias(
    model: mujoco.MjModel, simulated: SimulatedCrane, machine: Machine, states: States
) -> None:
    chain, data = pack_chain(simulated, machine), mujoco.MjData(model)
    ours_mass, theirs_mass = np.empty((STATES, 4, 4)), np.empty((STATES, 4, 4))
    ours_bias, theirs_bias = np.empty((STATES, 4)), np.empty((STATES, 4))
    for k, (q, v, _) in enumerate(zip(*states, strict=True)):
        mass_and_bias(chain, q, v, ours_mass[k], ours_bias[k])
        data.qpos[:], data.qvel[:] = q, v
        mujoco.mj_forward(model, data)
        mujoco.mj_fullM(model, data, theirs_mass[k])
        theirs_bias[k] = data.qfrc_bias
    assert_close(ours_mass, theirs_mass, 1e-8)
    assert_close(ours_bias, theirs_bias, 1e-8)


def test_inverse_dynamics_with_slew(
    model: mujoco.MjModel, simulated: SimulatedCrane, machine: Machine, states: States
) -> None:
    chain = pack_chain(simulated, machine)
    ours = np.array([inverse_dynamics(chain, *state) for state in zip(*states, strict=True)])
    assert_close(ours, inverse_by_mujoco(model, states), 1e-8)


def test_true_parameters_reproduce_mujoco_with_the_slew_held(
    model: mujoco.MjModel, simulated: SimulatedCrane, machine: Machine, states: States
) -> None:
    inertial = [entry.value for entry in true_parameters(simulated, machine)][:8]
    held = States(states.q, *(np.where(np.arange(4) == 0, 0.0, part) for part in states[1:]))
    regressor = np.empty((STATES, 3, 8))
    planar = (part[:, PLANAR] for part in held)
    fill_base_regressor(Geometry.of(machine), *planar, (0, 1, 2), regressor)
    assert_close(regressor @ inertial, inverse_by_mujoco(model, held)[:, PLANAR], 1e-9)
