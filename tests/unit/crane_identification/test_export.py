"""Exported models move in MuJoCo and in Pinocchio as they do in the suite."""

from pathlib import Path
from xml.etree import ElementTree as ET

import mujoco
import numpy as np
import pinocchio as pin
import pytest

from crane_identification import export_mjcf, export_urdf, identified_bodies
from crane_identification.export import main
from crane_model import (
    ConfigurationError,
    DataError,
    Model,
    Record,
    lever_arms,
    load_model,
    save_model,
    simulate,
)
from crane_model.chain.body_regressor import pseudo_inertia
from crane_model.chain.dynamics import inverse_dynamics
from crane_model.machine_files import machine_file
from crane_sim.parts.parameters import load_both
from crane_sim.true_values import true_parameters

MACHINES = ("laboratory_crane", "excavator", "single_axis", "double_telescope_crane")
STATES = 50
URDF_TOLERANCE, MJCF_TOLERANCE = 1e-8, 1e-4  # MuJoCo writes six digits


def known(name: str, *undetermined: str, symmetric: bool = False) -> Model:
    """The model of a shipped machine with the true values of its simulated crane."""
    model = load_model(machine_file("model.yaml", name))
    if symmetric:
        for term in model.terms:
            if term.asymmetry_of:
                model = model.without_term(term)
    true = {entry.name: entry.value for entry in true_parameters(*reversed(load_both(name, None)))}
    values = np.array([true[parameter.name] for parameter in model.parameters])
    std_devs = [
        1e6 if parameter.name in undetermined else max(1e-3 * abs(value), 1e-6)
        for parameter, value in zip(model.parameters, values, strict=True)
    ]
    return model.with_estimate(values, np.array(std_devs), "true values")


def states(model: Model) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(n, j) motion of all joints of the machine; those that the model lacks stand."""
    machine = model.machine
    assert machine is not None
    limits = [machine.limits[joint] for joint in machine.joint_names]
    low, high = np.array([(row.position_min, row.position_max) for row in limits]).T
    rng = np.random.default_rng(3)
    moves = np.isin(machine.joint_names, model.joints)
    shape = STATES, len(moves)
    q = rng.uniform(0.95 * low + 0.05 * high, 0.05 * low + 0.95 * high, shape)
    return q, rng.normal(size=shape) * moves, rng.normal(size=shape) * moves


def by_suite(model: Model) -> np.ndarray:
    """(n, j) forces of the identified rigid bodies."""
    columns = [model.machine.index(joint) for joint in model.joints]
    q, v, a = (part[:, columns] for part in states(model))
    record = Record(model.joints, np.arange(float(STATES)), q, v, a)
    bodies = [model.part(term) for term in model.terms if term.has_inertia()]
    regressor = model.regressor(record)
    return sum(regressor[:, :, part] @ model.theta[part] for part in bodies)


def by_mujoco(model: Model, text: str) -> np.ndarray:
    """(n, j) forces of all joints, without friction."""
    compiled = mujoco.MjModel.from_xml_string(text)
    compiled.dof_frictionloss[:] = compiled.dof_damping[:] = 0.0
    compiled.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_EQUALITY
    data, forces = mujoco.MjData(compiled), []
    lead = leading(model)
    for q, v, a in zip(*states(model), strict=True):
        data.qpos[:], data.qvel[:], data.qacc[:] = lead @ q, lead @ v, lead @ a
        mujoco.mj_inverse(compiled, data)
        forces.append(lead.T @ data.qfrc_inverse)
    return np.array(forces)


def leading(model: Model) -> np.ndarray:
    """(m, j) from coordinates to the joints of the chain, of which some follow others."""
    chain = model.machine.chain
    lead = np.zeros((len(chain.ratio), len(model.machine.joint_names)))
    lead[range(len(lead)), chain.leader] = chain.ratio
    return lead


def by_pinocchio(model: Model, text: str) -> np.ndarray:
    """The same."""
    read = pin.buildModelFromXML(text)
    data, lead = read.createData(), leading(model)
    return np.array(
        [
            lead.T @ pin.rnea(read, data, *(lead @ part for part in state))
            for state in zip(*states(model), strict=True)
        ]
    )


def agree(model: Model, theirs: np.ndarray, tolerance: float) -> None:
    """Whether forces on the joints of the model are those of the suite."""
    ours = by_suite(model)
    columns = [model.machine.index(joint) for joint in model.joints]
    scale = np.abs(ours).max(axis=0)
    np.testing.assert_allclose(theirs[:, columns] / scale, ours / scale, atol=tolerance)


@pytest.mark.parametrize("name", MACHINES)
def test_inverse_dynamics_are_those_of_the_suite(name: str) -> None:
    model = known(name)
    agree(model, by_pinocchio(model, export_urdf(model)), URDF_TOLERANCE)
    agree(model, by_mujoco(model, export_urdf(model)), URDF_TOLERANCE)
    agree(model, by_mujoco(model, export_mjcf(model)), MJCF_TOLERANCE)


@pytest.mark.parametrize("name", MACHINES)
def test_bodies_can_exist_and_have_the_identified_combinations(name: str) -> None:
    model = known(name)
    bodies = identified_bodies(model)
    assert (np.linalg.eigvalsh(pseudo_inertia(bodies.ten)) > 0.0).all()
    q, v, a = states(model)
    ours = inverse_dynamics(model.machine.chain, bodies.ten, q, v, a)
    agree(model, ours, URDF_TOLERANCE)


def test_motion_with_friction_is_that_of_the_suite() -> None:
    """Falls from rest under gravity and constant forces, with friction in all joints."""
    model = known("excavator", symmetric=True)
    compiled = mujoco.MjModel.from_xml_string(export_mjcf(model))
    compiled.opt.timestep = step = 2e-4
    data = mujoco.MjData(compiled)
    start = np.array([0.3, 0.4, -1.4, -0.8])
    still = np.zeros((1, 4))
    weight = model.gravity(Record(model.joints, np.zeros(1), start[np.newaxis], still, still))
    push = np.array([2e3, 3e3, -1.5e3, 8e2]) + weight
    drive = np.tile(push / lever_arms(model.machine, start[np.newaxis], model.joints), (102, 1, 1))
    ours = simulate(model, start[np.newaxis], np.zeros((1, 4)), drive, 10 * step, substeps=4)
    data.qpos[:] = start
    for force in ours.force[:-1, 0]:
        data.qfrc_applied[:] = force
        mujoco.mj_step(compiled, data, 10)
    path = np.ptp(ours.position[:, 0], axis=0)
    assert (path > 0.01).all()
    np.testing.assert_allclose(data.qpos, ours.position[-1, 0], atol=0.02 * path.min())


def test_a_prior_keeps_what_recordings_do_not_see(tmp_path: Path) -> None:
    model, prior = known("single_axis"), tmp_path / "cad.yaml"
    prior.write_text(
        "bodies:\n  boom: {mass: 180.0, centre_of_mass: [-0.8, 0.0, 0.0], "
        "inertia: [3.0, 40.0, 41.0], relative_std_dev: 0.2}\n"
    )
    bodies = identified_bodies(model, prior)
    (identified,), (ten,) = bodies.identified, bodies.ten
    assert identified.tolist() == [False, True, False, True, False, False, True, *[False] * 3]
    assert ten[1] == pytest.approx(known("single_axis").theta[0], rel=1e-9)
    assert ten[1] / ten[0] == pytest.approx(1.0, rel=0.05)  # its mass moves nothing
    text = export_urdf(model, prior)
    assert "not identified, from cad.yaml: m, my" in text
    agree(model, by_pinocchio(model, text), URDF_TOLERANCE)


def test_undetermined_values_are_left_to_the_prior() -> None:
    moment = load_model(machine_file("model.yaml", "single_axis")).parameters[0].name
    everything, less = known("single_axis"), known("single_axis", moment, "f_v.boom")
    assert identified_bodies(everything).identified.sum() == 3
    assert identified_bodies(less).identified.sum() == 2
    joint = ET.fromstring(export_urdf(less)).find("joint[@name='boom']/dynamics")
    assert joint is not None
    assert float(joint.get("damping", "")) == 0.0 < float(joint.get("friction", ""))
    assert "viscous not determined" in export_urdf(less)


def test_joints_that_follow_others_do_so_in_mujoco() -> None:
    model = known("double_telescope_crane")
    compiled = mujoco.MjModel.from_xml_string(export_mjcf(model))
    follower = next(joint.name for joint in model.machine.joints if joint.follows is not None)
    assert compiled.neq == 1
    assert compiled.eq_type[0] == mujoco.mjtEq.mjEQ_JOINT
    assert follower in {compiled.joint(number).name for number in compiled.eq_obj1id}


def test_comments_say_what_a_urdf_cannot_hold() -> None:
    text = export_urdf(known("laboratory_crane"))
    assert "coulomb_asymmetry of inner_boom" in text
    assert "No recording moved slew" in text
    assert "telescope: identified alone: m, mx, mz" in text
    assert "telescope: identified alone: m, mx, mz" in export_mjcf(known("laboratory_crane"))


def test_what_cannot_be_exported_is_refused() -> None:
    model = known("single_axis")
    values = model.theta.copy()
    values[[parameter.unit for parameter in model.parameters].index("kg m2")] = -5.0
    with pytest.raises(DataError, match="no bodies have its rigid-body parameters"):
        identified_bodies(model.with_estimate(values, 1e-3 * np.ones(len(values)), "by hand"))
    with pytest.raises(ConfigurationError, match="no values yet"):
        identified_bodies(load_model(machine_file("model.yaml")))


@pytest.mark.parametrize("suffix", ["urdf", "xml"])
def test_command(tmp_path: Path, suffix: str, capsys: pytest.CaptureFixture[str]) -> None:
    model, out = tmp_path / "model.yaml", tmp_path / f"crane.{suffix}"
    save_model(model, known("excavator"))
    words = ["--model", str(model), "--out"]
    assert main([*words, str(out)]) == 0
    assert mujoco.MjModel.from_xml_path(str(out)).nv == 4
    assert main([*words, str(out)]) == 1
    assert main([*words, str(tmp_path / "crane.sdf")]) == 1
    assert "no format ends in '.sdf'" in capsys.readouterr().err
