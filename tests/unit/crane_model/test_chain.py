"""Serial chains in space against Pinocchio: regressor, M, C, G, poses, and motion by MuJoCo."""

from pathlib import Path
from typing import NamedTuple

import mujoco
import numpy as np
import pinocchio as pin
import pytest
from unit.crane_model.pinocchio_chain import pinocchio_chain, random_bodies

from crane_model import Machine, load_machine, tip_jacobian, tip_position
from crane_model.chain import body_regressor, dynamics

TOLERANCE = 1e-9
STATES = 50


def random_machine(seed: int) -> Machine:
    """2 to 7 joints that turn or slide about any axes, at any places, below a tilted base."""
    rng = np.random.default_rng(seed)
    limits = {"position_min": -3.0, "position_max": 3.0, "velocity_min": -1.0, "velocity_max": 1.0}

    def place() -> dict[str, list[float]]:
        return {"xyz": rng.uniform(-1, 1, 3).tolist(), "rpy": rng.uniform(-3, 3, 3).tolist()}

    joints = []
    for i in range(2 + seed % 6):
        joint = {
            "name": f"joint_{i}",
            "kind": ("revolute", "prismatic")[int(rng.uniform() < 0.3)],
            "limits": limits,
            "actuator": {"type": "passive"},
        }
        if rng.uniform() < 0.5:
            joint["dh"] = dict(
                zip(("theta", "d", "a", "alpha"), rng.uniform(-2, 2, 4).tolist(), strict=True)
            )
        else:
            joint |= {"origin": place(), "axis": rng.standard_normal(3).tolist()}
        joints.append(joint)
    return Machine.model_validate(
        {
            "name": f"chain {seed}",
            "gravity": rng.uniform(-9, 9, 3).tolist(),
            "base": place(),
            "joints": joints,
            "tool": place(),
        }
    )


class Case(NamedTuple):
    machine: Machine
    model: pin.Model
    bodies: np.ndarray
    q: np.ndarray
    v: np.ndarray
    a: np.ndarray

    def of_pinocchio(self, function, *motion: np.ndarray) -> np.ndarray:
        """What it says of each sample; of one joint, arrays without the axis of length 1 too."""
        data, rows = self.model.createData(), zip(*motion, strict=True)
        return np.array([np.copy(function(self.model, data, *row)) for row in rows])


def case(machine: Machine, seed: int) -> Case:
    rng = np.random.default_rng(seed)
    bodies = random_bodies(len(machine.joints), rng)
    q, v, a = rng.standard_normal((3, STATES, len(machine.joints))) * [[[1.0]], [[2.0]], [[5.0]]]
    return Case(machine, pinocchio_chain(machine, bodies), bodies, q, v, a)


SHIPPED = ("laboratory_crane", "excavator", "single_axis")
KUKA = Path(__file__).parents[2] / "machines" / "kuka_kr300.yaml"


MACHINES = {
    **{name: lambda name=name: load_machine(name) for name in SHIPPED},
    "kuka": lambda: load_machine(KUKA),
    **{f"chain {seed}": lambda seed=seed: random_machine(seed) for seed in range(20)},
}


@pytest.fixture(params=MACHINES)
def one(request: pytest.FixtureRequest) -> Case:
    return case(MACHINES[request.param](), 7)


def worst_error(ours: np.ndarray, theirs: np.ndarray) -> float:
    """Largest difference over samples, each relative to the norm of its own entries."""
    rows = len(theirs)
    difference = np.linalg.norm(ours.reshape(rows, -1) - theirs.reshape(rows, -1), axis=1)
    return float((difference / np.linalg.norm(theirs.reshape(rows, -1), axis=1)).max())


def accelerations(
    machine: Machine, bodies: np.ndarray, q: np.ndarray, v: np.ndarray, force: np.ndarray
) -> np.ndarray:
    """q'' under forces (n, j), by M(q) and the other forces of (6) from inverse dynamics."""
    chain, none = machine.chain._replace(gravity=np.zeros(3)), np.zeros_like(q)
    columns = [
        dynamics.inverse_dynamics(chain, bodies, q, none, none + unit)
        for unit in np.eye(q.shape[1])
    ]
    rest = force - dynamics.inverse_dynamics(machine.chain, bodies, q, v, none)
    return np.linalg.solve(np.stack(columns, axis=2), rest[..., np.newaxis])[..., 0]


def test_pinocchio_agrees(one: Case) -> None:
    chain, motion = one.machine.chain, (one.q, one.v, one.a)
    ours = body_regressor.regressor(chain, *motion)
    assert ours.shape == (STATES, len(one.machine.joints), 10 * len(one.bodies))
    theirs = one.of_pinocchio(pin.computeJointTorqueRegressor, *motion)
    assert worst_error(ours, theirs) < TOLERANCE

    theirs = one.of_pinocchio(pin.rnea, *motion)
    assert worst_error(dynamics.inverse_dynamics(chain, one.bodies, *motion), theirs) < TOLERANCE
    assert worst_error(ours @ one.bodies.ravel(), theirs) < TOLERANCE

    theirs = one.of_pinocchio(pin.computeGeneralizedGravity, one.q)
    assert worst_error(dynamics.gravity_forces(chain, one.bodies, one.q), theirs) < TOLERANCE

    theirs = one.of_pinocchio(pin.aba, *motion)  # under forces as large as the accelerations
    assert worst_error(accelerations(one.machine, one.bodies, *motion), theirs) < 1e-6


def test_poses_and_jacobians(one: Case) -> None:
    tip, data = one.model.getFrameId("tip"), one.model.createData()
    places, jacobians = [], []
    for q in one.q:
        moved = pin.computeFrameJacobian(one.model, data, q, tip, pin.LOCAL_WORLD_ALIGNED)
        jacobians.append(moved.reshape(6, -1).copy())
        places.append(data.oMf[tip].translation.copy())
    np.testing.assert_allclose(tip_position(one.machine, one.q), places, atol=1e-10)
    ours = tip_jacobian(one.machine, one.q)
    np.testing.assert_allclose(ours, np.array(jacobians)[:, :3], atol=1e-10)


def test_the_published_flange_of_the_robot_at_home() -> None:
    home = tip_position(load_machine(KUKA), np.zeros((1, 6)))
    np.testing.assert_allclose(home, [[1.590, 0.0, 1.784]], atol=1e-12)


def two_sections(machine: Machine) -> tuple[Machine, np.ndarray]:
    """The crane whose sections move by themselves, and C (5, 4) that holds them together."""
    joints = tuple(
        one.model_copy(update={"follows": None, "limits": machine.limits["telescope"]})
        for one in machine.joints
    )
    held = np.zeros((5, 4))
    held[:4], held[4, 3] = np.eye(4), 1.0
    return machine.model_copy(update={"joints": joints}), held


def test_joints_that_follow_move_and_load_their_leader() -> None:
    """A double telescope is its two sections held together: q = C q_leaders, tau = C^T tau."""
    machine = load_machine("double_telescope_crane")
    assert machine.joint_names == ("slew", "inner_boom", "outer_boom", "telescope")
    free, held = two_sections(machine)
    bodies = random_bodies(5, np.random.default_rng(1))
    q, v, a = np.random.default_rng(2).standard_normal((3, STATES, 4))
    wide = [each @ held.T for each in (q, v, a)]
    loose = Case(free, pinocchio_chain(free, bodies), bodies, *wide)
    theirs = loose.of_pinocchio(pin.rnea, *wide) @ held
    np.testing.assert_allclose(
        dynamics.inverse_dynamics(machine.chain, bodies, q, v, a), theirs, atol=1e-9
    )
    ours = body_regressor.regressor(machine.chain, q, v, a) @ bodies.ravel()
    np.testing.assert_allclose(ours, theirs, atol=1e-9)
    np.testing.assert_allclose(tip_position(machine, q), tip_position(free, wide[0]), atol=1e-12)
    ours = tip_jacobian(machine, q)
    np.testing.assert_allclose(ours, tip_jacobian(free, wide[0]) @ held, atol=1e-12)


def quaternion(rotation: np.ndarray) -> np.ndarray:
    result = np.empty(4)
    mujoco.mju_mat2Quat(result, rotation.ravel())
    return result


def in_mujoco(machine: Machine, bodies: np.ndarray) -> mujoco.MjModel:
    """The machine in MuJoCo, body by body, with the Runge-Kutta method of fourth order."""
    spec = mujoco.MjSpec()
    spec.option.gravity = machine.gravity_vector
    spec.option.timestep = 1e-3
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_RK4
    parent, chain = spec.worldbody, machine.chain
    for i, ten in enumerate(bodies):
        inertia = pin.Inertia.FromDynamicParameters(ten)
        of, kind = inertia.inertia, mujoco.mjtJoint
        place = {"pos": chain.translation[i], "quat": quaternion(chain.rotation[i])}
        parent = parent.add_body(name=machine.joints[i].name, **place)
        parent.mass, parent.ipos, parent.explicitinertial = inertia.mass, inertia.lever, True
        parent.fullinertia = [of[0, 0], of[1, 1], of[2, 2], of[0, 1], of[0, 2], of[1, 2]]
        slides = chain.slides[i]
        parent.add_joint(type=kind.mjJNT_SLIDE if slides else kind.mjJNT_HINGE, axis=chain.axis[i])
    return spec.compile()


@pytest.mark.parametrize("name", [*SHIPPED, "chain 3"])
def test_mujoco_agrees_on_the_motion(name: str) -> None:
    """Falling freely for 0.3 s; ours by the classical Runge-Kutta method, too."""
    machine = MACHINES[name]()
    bodies = random_bodies(len(machine.joints), np.random.default_rng(5))
    model = in_mujoco(machine, bodies)
    data, step = mujoco.MjData(model), model.opt.timestep
    none = np.zeros((1, model.nv))

    def rate(state: np.ndarray) -> np.ndarray:
        q, v = state
        return np.array([v, accelerations(machine, bodies, q, v, none)])

    state = np.random.default_rng(6).uniform(-0.5, 0.5, (2, 1, model.nv))
    data.qpos[:], data.qvel[:] = state[:, 0]
    for _ in range(300):
        mujoco.mj_step(model, data)
        k1 = rate(state)
        k2 = rate(state + step / 2 * k1)
        k3 = rate(state + step / 2 * k2)
        k4 = rate(state + step * k3)
        state = state + step / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    np.testing.assert_allclose(state[0, 0], data.qpos, atol=1e-8)
    np.testing.assert_allclose(state[1, 0], data.qvel, atol=1e-7)


def test_mujoco_agrees_on_the_acceleration_of_a_joint_that_follows() -> None:
    """Of its two sections held together, without forces: C^T M C a = -C^T h."""
    machine = load_machine("double_telescope_crane")
    free, held = two_sections(machine)
    bodies = random_bodies(5, np.random.default_rng(5))
    model = in_mujoco(free, bodies)
    data, mass = mujoco.MjData(model), np.zeros((5, 5))
    for q, v in np.random.default_rng(6).standard_normal((20, 2, 4)):
        data.qpos[:], data.qvel[:] = held @ q, held @ v
        mujoco.mj_forward(model, data)
        mujoco.mj_fullM(model, data, mass)
        theirs = np.linalg.solve(held.T @ mass @ held, -held.T @ data.qfrc_bias)
        motion = q[np.newaxis], v[np.newaxis], np.zeros((1, 4))
        (ours,) = accelerations(machine, bodies, *motion)
        np.testing.assert_allclose(ours, theirs, rtol=1e-8, atol=1e-8)
