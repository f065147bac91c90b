"""Rigid bodies of any machine as a term: base parameters and their names, rotors, couplings."""

from pathlib import Path

import numpy as np
import pytest
from unit.crane_model.pinocchio_chain import random_bodies

from crane_model import ConfigurationError, Machine, Model, Record, lever_arms, load_machine
from crane_model.base_parameters import base_set, reveal_rank
from crane_model.chain import body_regressor, dynamics
from crane_model.cylinders import cylinder_forces_from_generalized, generalized_from_actuators
from crane_model.terms import Setting
from crane_model.terms.drives import RotorInertia
from crane_model.terms.rigid_body import BASE_PARAMETERS, PlanarRigidBody, SerialRigidBody

SAMPLES = 60
KUKA = Path(__file__).parents[2] / "machines" / "kuka_kr300.yaml"
BASE_COUNTS = {  # the robot's from the literature, the others by the rank of the whole regressor
    "laboratory_crane": 19,
    "double_telescope_crane": 20,
    "excavator": 22,
    "single_axis": 3,
    str(KUKA): 36,
}


def setting(machine: Machine, joints: tuple[str, ...] | None = None) -> Setting:
    units = {joint: machine.units[joint] for joint in joints or machine.joint_names}
    return Setting(units, machine)


def motion(joints: tuple[str, ...], seed: int = 3) -> Record:
    states = np.random.default_rng(seed).standard_normal((3, SAMPLES, len(joints)))
    return Record(joints, np.arange(SAMPLES) * 0.01, *states)


@pytest.mark.parametrize("name", BASE_COUNTS)
def test_base_parameters_are_all_that_the_motion_determines(name: str) -> None:
    machine = load_machine(name)
    record, of = motion(machine.joint_names), setting(machine)
    term = SerialRigidBody()
    bodies = random_bodies(len(machine.joints), np.random.default_rng(1))
    states = record.position, record.velocity, record.acceleration
    whole = body_regressor.regressor(machine.chain, *states)
    columns = term.columns(record, of)
    base = base_set(machine, machine.joint_names)
    expected = whole @ bodies.ravel()
    found = columns @ (base.combination @ bodies.ravel())
    np.testing.assert_allclose(found, expected, atol=1e-8 * np.abs(expected).max())
    count = len(term.parameters(of))
    assert reveal_rank(whole.reshape(-1, whole.shape[-1])).rank == count == BASE_COUNTS[name]
    assert reveal_rank(columns.reshape(-1, count)).rank == count


@pytest.mark.parametrize("name", BASE_COUNTS)
def test_a_moment_is_not_an_inertia_over_a_length(name: str) -> None:
    """Masses combine with masses, and moments with moments and masses on arms."""
    machine = load_machine(name)
    for joints in (machine.joint_names, machine.joint_names[1:]):
        if not joints:
            continue
        base = base_set(machine, joints)
        order = np.array(
            [np.clip(len(quantity.split(".")[0]) - 1, 0, 2) for quantity in base.names]
        )
        for leading, parts in zip(base.leading, base.combination, strict=True):
            assert (order[parts != 0.0] <= order[leading]).all(), base.names[leading]


SCARA = """name: scara
gravity: 9.81
joints:
  - {name: shoulder, kind: revolute, dh: {a: 0.35}, limits: &angle {position_min: -2.5,
     position_max: 2.5, velocity_min: -3.0, velocity_max: 3.0}, actuator: {type: passive}}
  - {name: elbow, kind: revolute, dh: {a: 0.3}, limits: *angle, actuator: {type: passive}}
  - {name: slide, kind: prismatic, dh: {}, limits: {position_min: -0.2, position_max: 0.2,
     velocity_min: -1.0, velocity_max: 1.0}, actuator: {type: passive}}
  - {name: wrist, kind: revolute, dh: {}, limits: *angle, actuator: {type: passive}}
"""


def test_a_slide_along_the_joint_before_it_adds_to_what_that_joint_turns(tmp_path: Path) -> None:
    (tmp_path / "machine.yaml").write_text(SCARA)
    machine = load_machine(tmp_path / "machine.yaml")
    meanings = {one.name: one.meaning for one in SerialRigidBody().parameters(setting(machine))}
    assert meanings == {
        "Izz_r.shoulder": "inertia about the axis of shoulder, Izz.shoulder + 0.1225 m.elbow",
        "mx_r.elbow": "mass moment along x of elbow, mx.elbow + mx.slide",
        "my_r.elbow": "mass moment along y of elbow, my.elbow + my.slide",
        "Izz_r.elbow": "inertia about the axis of elbow, Izz.elbow + 0.6 mx.slide + Izz.slide",
        "m_r.slide": "mass that slide moves, m.slide + m.wrist",
        "mx.wrist": "mass moment along x of wrist",
        "my.wrist": "mass moment along y of wrist",
        "Izz.wrist": "inertia about the axis of wrist",
    }


def test_each_is_named_as_the_combination_that_it_is() -> None:
    machine = load_machine("excavator")
    by_name = {one.name: one for one in SerialRigidBody().parameters(setting(machine))}
    assert by_name["mx.bucket"].meaning == "mass moment along x of bucket"
    assert by_name["my.bucket"].unit == "kg m"
    assert by_name["mx_r.boom"].meaning == (
        "mass moment along x of boom, mx.boom + 2.05 m.stick + 2.05 m.bucket"
    )
    regrouped = by_name["Izz_r.stick"]
    assert regrouped.meaning == "inertia about the axis of stick, Izz.stick + 1.1025 m.bucket"
    assert (regrouped.unit, regrouped.minimum) == ("kg m2", 0.0)
    assert by_name["Ixx_r.bucket"].meaning == ("inertia about x of bucket, Ixx.bucket - Iyy.bucket")
    assert by_name["Ixx_r.bucket"].minimum is None


def test_the_swing_has_parameters_of_its_own_where_it_is_measured() -> None:
    machine = load_machine("excavator")
    of_arm = SerialRigidBody().parameters(setting(machine, machine.joint_names[1:]))
    assert [one.name for one in of_arm] == [
        *("mx_r.boom", "my.boom", "Izz_r.boom"),
        *("mx_r.stick", "my.stick", "Izz_r.stick"),
        *("mx.bucket", "my.bucket", "Izz.bucket"),
    ]
    names = {one.name for one in SerialRigidBody().parameters(setting(machine))}
    assert names >= {one.name for one in of_arm} | {"Izz_r.swing"}


ARM = """
name: arm
gravity: 9.81
joints:
"""
JOINT = """
  - name: {name}
    kind: {kind}
    origin: {{xyz: {place}, rpy: {turned}}}
    axis: {axis}
    limits: {{position_min: -2.5, position_max: 2.5, velocity_min: -2, velocity_max: 2}}
    actuator: {{type: electric_drive, gear_ratio: 100}}
"""


def arm(folder: Path, *joints: tuple[str, str, list[float], list[float], list[float]]) -> Machine:
    """Joints as a URDF has them: name, kind, place and turn in the frame before, axis."""
    keys = ("name", "kind", "place", "turned", "axis")
    parts = [JOINT.format(**dict(zip(keys, joint, strict=True))) for joint in joints]
    path = folder / "machine.yaml"
    path.write_text(ARM + "".join(parts))
    return load_machine(path)


@pytest.mark.parametrize("axis", [[0, 1, 0], [0, -1, 0], [1, 0, 0], [0, 0, 1]])
def test_names_follow_the_axes_of_joints(tmp_path: Path, axis: list[float]) -> None:
    """A turntable under two joints whose axes are level, along any coordinate of their frames."""
    level = {0: [0, 0, 0], 1: [0, 0, 0], 2: [np.pi / 2, 0, 0]}[int(np.argmax(np.abs(axis)))]
    machine = arm(
        tmp_path,
        ("base", "revolute", [0, 0, 0.1], [0, 0, 0], [0, 0, 1]),
        ("lower", "revolute", [0.1, 0.1, 0.2], level, axis),
        ("upper", "revolute", [0.3, 0.3, 0.3], [0, 0, 0], axis),
    )
    parameters = SerialRigidBody().parameters(setting(machine))
    by_name = {one.name: one.meaning for one in parameters}
    assert by_name["Izz_r.base"].startswith("inertia about the axis of base, Izz.base + ")
    along = "xyz"[int(np.argmax(np.abs(axis)))]
    assert by_name[f"I{along}{along}_r.lower"].startswith("inertia about the axis of lower, ")
    assert not [name for name in by_name if name.startswith((f"m{along}", "m."))]


def test_the_mass_on_a_slide_is_named_after_the_slide(tmp_path: Path) -> None:
    machine = arm(
        tmp_path,
        ("lift", "prismatic", [0, 0, 0.2], [0, 0, 0], [0, 0, 1]),
        ("shoulder", "revolute", [0.2, 0, 0.2], [0, 0, 0], [0, 0, 1]),
        ("elbow", "revolute", [0.1, 0, 0], [-np.pi / 2, 0, 0], [0, 0, 1]),
    )
    by_name = {one.name: one.meaning for one in SerialRigidBody().parameters(setting(machine))}
    assert by_name["m_r.lift"] == "mass that lift moves, m.lift + m.shoulder + m.elbow"


@pytest.mark.parametrize("zero", [(), ("mx.telescope",)])
def test_the_planar_crane_has_its_own_parameters(machine: Machine, zero: tuple[str, ...]) -> None:
    """Those of the report where the telescope's centre of mass lies on its axis, and a ninth."""
    joints = machine.planar.joints
    of, term = setting(machine, joints), SerialRigidBody(zero=zero)
    parameters = term.parameters(of)
    assert parameters[:8] == BASE_PARAMETERS
    assert [one.name for one in parameters[8:]] == ([] if zero else ["S_TL_normal"])
    shuffled = (joints[2], joints[0], joints[1])
    record = motion(shuffled)
    ours, planar = term.columns(record, of), PlanarRigidBody().columns(record, of)
    if zero:
        np.testing.assert_allclose(ours, planar, atol=1e-10)
    else:
        a3 = machine.planar.telescope_offset
        axis = ours[:, :, :8].copy()
        axis[:, :, 6] += a3 * ours[:, :, 8]
        np.testing.assert_allclose(axis, planar, atol=1e-10)


def test_joints_that_the_model_lacks_stand_still(machine: Machine) -> None:
    joints = ("outer_boom", "telescope")
    record, of, term = motion(joints), setting(machine, joints), SerialRigidBody()
    q, v, a = np.zeros((3, SAMPLES, 4))
    q[:, 2:], v[:, 2:], a[:, 2:] = record.position, record.velocity, record.acceleration
    bodies = random_bodies(4, np.random.default_rng(4))
    expected = dynamics.inverse_dynamics(machine.chain, bodies, q, v, a)[:, 2:]
    theta = base_set(machine, joints).combination @ bodies.ravel()
    np.testing.assert_allclose(term.columns(record, of) @ theta, expected, atol=1e-8)


@pytest.mark.parametrize(
    ("zero", "told"),
    [(("mx.arm",), "no parameter 'mx.arm'; there are m, mx, "), (("telescope",), "'telescope'")],
)
def test_a_parameter_that_is_none(machine: Machine, zero: tuple[str, ...], told: str) -> None:
    with pytest.raises(ConfigurationError, match=told):
        SerialRigidBody(zero=zero).parameters(setting(machine))


def test_without_a_machine_there_are_no_bodies() -> None:
    with pytest.raises(ConfigurationError, match="serial_rigid_body': needs a machine"):
        SerialRigidBody().parameters(Setting({"axis": "rad"}, None))


def test_a_rotor_counts_with_the_square_of_its_gear() -> None:
    machine = load_machine(KUKA)
    record, of = motion(machine.joint_names), setting(machine)
    term = RotorInertia(joint="axis_4")
    (parameter,) = term.parameters(of)
    assert (parameter.name, parameter.unit) == ("I_rotor.axis_4", "kg m2")
    expected = np.zeros((SAMPLES, 6))
    expected[:, 3] = 221.0**2 * record.acceleration[:, 3]
    np.testing.assert_allclose(term.columns(record, of)[:, :, 0], expected)
    crane = setting(load_machine())
    with pytest.raises(ConfigurationError, match="with a motor at joint 'slew'; it has no motor"):
        RotorInertia(joint="slew").parameters(crane)


MATRIX = ((1.0, 0.0, 0.0), (-0.1, 1.0, 0.0), (0.2, -0.3, 1.0))


@pytest.fixture
def coupled() -> Machine:
    content = load_machine(KUKA).model_dump(exclude_none=True)
    wrist = ("axis_4", "axis_5", "axis_6")
    return Machine.model_validate(content | {"couplings": [{"joints": wrist, "matrix": MATRIX}]})


def test_coupled_drives_share_their_power_between_the_joints(coupled: Machine) -> None:
    """Virtual work: what the motors do is what the joints get, at any speed."""
    joints = coupled.joint_names
    q, v, torque = np.random.default_rng(2).standard_normal((3, SAMPLES, 6))
    tau = generalized_from_actuators(coupled, q, torque, joints)
    seen = v.copy()
    seen[:, 3:] = v[:, 3:] @ np.array(MATRIX).T
    speeds = seen * lever_arms(coupled, q, joints)
    np.testing.assert_allclose((tau * v).sum(axis=1), (torque * speeds).sum(axis=1))
    back = cylinder_forces_from_generalized(coupled, q, tau, joints)
    np.testing.assert_allclose(back, torque, atol=1e-12)


def test_a_coupled_rotor_has_the_kinetic_energy_of_what_turns_it(coupled: Machine) -> None:
    """The column of 1 kg m2 is M q'' with q'^T M q' the square of the rotor's speed."""
    record, of = motion(coupled.joint_names), setting(coupled)
    column = RotorInertia(joint="axis_6").columns(record, of)[:, :, 0]
    gear = coupled.actuators["axis_6"].gear_ratio
    row = gear * np.array([0.0, 0.0, 0.0, *MATRIX[2]])
    np.testing.assert_allclose(column, record.acceleration @ np.outer(row, row), atol=1e-6)
    wrist = setting(coupled, ("axis_6",))
    with pytest.raises(ConfigurationError, match="also turns with axis_4, axis_5, which the model"):
        RotorInertia(joint="axis_6").parameters(wrist)


def test_a_model_of_bodies_and_a_rotor() -> None:
    machine = load_machine("excavator")
    model = Model("arm", setting(machine), (SerialRigidBody(), RotorInertia(joint="swing")))
    assert model.regressor(motion(machine.joint_names)).shape == (SAMPLES, 4, 23)
