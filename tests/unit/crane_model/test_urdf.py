"""The URDF of a machine, read by Pinocchio, is the machine; and a URDF becomes its file."""

from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np
import pinocchio as pin
import pytest
from laboratory_crane import JOINTS

from crane_identification.estimation.prior import load_prior
from crane_model import ConfigurationError, Machine, load_machine, load_model, tip_position
from crane_model.inspection import poses
from crane_model.inspection.machine_command import main
from crane_model.urdf import urdf
from crane_model.urdf_reading import MISSING, bodies_from_urdf, machine_file_from_urdf

KUKA = Path(__file__).parents[2] / "machines" / "kuka_kr300.yaml"
MACHINES = ["laboratory_crane", "excavator", "single_axis", str(KUKA)]


def coordinates(machine: Machine) -> np.ndarray:
    low, _, high = poses(machine)
    return np.random.default_rng(4).uniform(low, high, (200, len(low)))


@pytest.mark.parametrize("name", MACHINES)
def test_tip_agrees_with_forward_kinematics(name: str) -> None:
    machine = load_machine(name)
    model = pin.buildModelFromXML(urdf(machine))
    data, tip = model.createData(), model.getFrameId("tip")
    assert tuple(model.names)[1:] == machine.joint_names
    q, theirs = coordinates(machine), []
    for row in q:
        pin.framesForwardKinematics(model, data, row)
        theirs.append(data.oMf[tip].translation.copy())
    np.testing.assert_allclose(tip_position(machine, q), theirs, atol=1e-9)


def test_limits_are_those_of_table_2(machine: Machine) -> None:
    model = pin.buildModelFromXML(urdf(machine))
    for i, joint in enumerate(JOINTS):
        limits = machine.limits[joint]
        assert model.lowerPositionLimit[i] == limits.position_min
        assert model.upperPositionLimit[i] == limits.position_max
        assert model.velocityLimit[i] == max(-limits.velocity_min, limits.velocity_max)


@pytest.mark.parametrize("joint", JOINTS)
def test_effort_is_what_the_supply_can_push(machine: Machine, joint: str) -> None:
    limits, cylinder = machine.limits[joint], machine.cylinders[joint]
    (element,) = ET.fromstring(urdf(machine)).findall(f"joint[@name='{joint}']/limit")
    q = np.linspace(limits.position_min, limits.position_max, 2001)
    lever = np.abs(machine.cylinder(joint, q)[:, 1]).max()
    effort = machine.hydraulics.supply_pressure * cylinder.area_a * lever
    assert float(element.get("effort")) == pytest.approx(effort, rel=1e-4)


@pytest.mark.parametrize("name", [*MACHINES, "double_telescope_crane"])
def test_every_moving_link_is_drawn(name: str) -> None:
    links = ET.fromstring(urdf(load_machine(name))).findall("link")
    undrawn = {link.get("name") for link in links if link.find("visual") is None}
    assert undrawn == {"tip"}


@pytest.mark.parametrize("name", [*MACHINES, "double_telescope_crane"])
def test_a_urdf_becomes_a_machine_file(tmp_path: Path, name: str) -> None:
    """What a URDF knows comes back; what drives the joints is marked as missing, and passive."""
    machine = load_machine(name)
    file = tmp_path / "arm.urdf"
    file.write_text(urdf(machine))
    text, missing = machine_file_from_urdf(file)
    (tmp_path / "machine.yaml").write_text(text)
    back = load_machine(tmp_path / "machine.yaml")
    assert back.joint_names == machine.joint_names
    assert dict(back.units) == dict(machine.units)
    q = coordinates(machine)
    np.testing.assert_allclose(tip_position(back, q), tip_position(machine, q), atol=1e-9)
    for joint in machine.joint_names:
        own, read = machine.limits[joint], back.limits[joint]
        assert (read.position_min, read.position_max) == (own.position_min, own.position_max)
        assert back.actuators[joint].type == "passive"
    assert missing == text.count(MISSING) - 1 >= len(machine.joint_names) + 2


ARM = """<robot name="arm">
<link name="world"/> <link name="house"/> <link name="boom"/> <link name="camera"/>
<joint name="mount" type="fixed"><parent link="world"/><child link="house"/>
  <origin xyz="0 0 1"/></joint>
<joint name="swing" type="continuous"><parent link="house"/><child link="boom"/>
  <origin xyz="0.5 0 0"/><axis xyz="0 0 1"/></joint>
<joint name="lens" type="fixed"><parent link="boom"/><child link="camera"/>
  <origin xyz="0 0 0.2"/></joint>
</robot>"""


def read(tmp_path: Path, text: str, tip: str | None = None) -> str:
    file = tmp_path / "arm.urdf"
    file.write_text(text)
    return machine_file_from_urdf(file, tip)[0]


def test_fixed_joints_are_part_of_the_next_and_limits_that_are_not_there_are_marked(
    tmp_path: Path,
) -> None:
    text = read(tmp_path, ARM, "camera")
    (tmp_path / "machine.yaml").write_text(text)
    machine = load_machine(tmp_path / "machine.yaml")
    np.testing.assert_allclose(tip_position(machine, [[0.3]]), [[0.5, 0.0, 1.2]])
    (limits,) = [line for line in text.splitlines() if "limits:" in line]
    assert limits.endswith("# MISSING: range of positions, largest velocities")
    assert machine.limits["swing"].position_max == pytest.approx(np.pi)


TWICE = """
  <link name="hook"/>
  <joint name="{}" type="fixed"><parent link="house"/><child link="{}"/></joint>
</robot>"""


@pytest.mark.parametrize(
    ("change", "tip", "told"),
    [
        (("continuous", "floating"), None, "joint 'swing': of type floating; an arm has revolute"),
        (("robot", "xacro"), None, "no URDF: its root is <xacro>"),
        (("</robot>", ""), None, "not valid XML"),
        (("0.5 0 0", "0.5 0"), None, "joint 'swing': xyz must be three numbers, got '0.5 0'"),
        (('<parent link="house"/>', ""), None, "joint 'swing': has no parent link"),
        (("swing", "swing joint"), None, "joint 'swing joint': a machine file needs names of"),
        (("", ""), "house", "no joint moves link 'house'; name one of boom, camera by --tip"),
        (('link="world"/><child', 'link="boom"/><child'), None, "go round in a circle"),
        (
            ('0 0 1"/></joint>\n<joint name="lens', '0 0 0"/></joint>\n<joint name="lens'),
            None,
            "has the length 0",
        ),
        (("0.5 0 0", "0.5 nan 0"), None, "xyz must be three numbers, got '0.5 nan 0'"),
        (("</robot>", TWICE.format("swing", "hook")), None, "2 joints are called 'swing'"),
        (("</robot>", TWICE.format("other", "boom")), None, "2 joints lead to link 'boom'"),
    ],
)
def test_what_is_no_arm_is_refused(
    tmp_path: Path, change: tuple[str, str], tip: str | None, told: str
) -> None:
    with pytest.raises(ConfigurationError, match=told):
        read(tmp_path, ARM.replace(*change) if change[0] else ARM, tip)


RANGE = "range of positions"
SWAPPED = f"{RANGE}, whose limits are swapped"


def limits_of(tmp_path: Path, joint: str, text: str) -> tuple[float, float, str]:
    """Of a joint, in the file written from a URDF, with what is marked."""
    (tmp_path / "machine.yaml").write_text(text)
    limits = load_machine(tmp_path / "machine.yaml").limits[joint]
    lines = [line for line in text.split(f"name: {joint}\n")[1].splitlines() if "limits:" in line]
    return limits.position_min, limits.position_max, lines[0].partition("# MISSING: ")[2]


@pytest.mark.parametrize(
    ("kind", "limit", "low", "high", "marked"),
    [
        (
            "revolute",
            'lower="1.2" upper="-0.7" velocity="2"',
            -0.7,
            1.2,
            SWAPPED,
        ),
        (
            "prismatic",
            'lower="0.4" upper="0.1" velocity="2"',
            0.1,
            0.4,
            SWAPPED,
        ),
        ("prismatic", 'velocity="2"', 0.0, 1.0, RANGE),
        ("prismatic", "", 0.0, 1.0, f"{RANGE}, largest velocities"),
        ("prismatic", 'lower="-inf" upper="inf" velocity="2"', 0.0, 1.0, RANGE),
        ("prismatic", 'lower="-1e16" upper="1e16" velocity="2"', 0.0, 1.0, RANGE),
        (
            "revolute",
            'lower="-1e10" upper="1e10" velocity="2"',
            -np.pi,
            np.pi,
            "range of positions",
        ),
        ("revolute", 'lower="nan" upper="1" velocity="nan"', -np.pi, np.pi, f"{RANGE}, "),
        ("prismatic", 'lower="0" upper="0.5" velocity="2"', 0.0, 0.5, ""),
    ],
)
def test_limits_that_are_none_or_swapped_are_marked(
    tmp_path: Path, kind: str, limit: str, low: float, high: float, marked: str
) -> None:
    arm = ARM.replace("continuous", kind).replace('<axis xyz="0 0 1"/>', f"<limit {limit}/>")
    found_low, found_high, told = limits_of(tmp_path, "swing", read(tmp_path, arm))
    assert (found_low, found_high) == (pytest.approx(low), pytest.approx(high))
    assert told.startswith(marked)
    assert bool(told) == bool(marked)


XACRO = """<robot name="arm" xmlns:xacro="http://www.ros.org/wiki/xacro">
<link name="a"/> <link name="b"/>
<joint name="lift" type="revolute"><parent link="a"/><child link="b"/>INSIDE</joint>
</robot>"""


@pytest.mark.parametrize(
    ("file", "inside", "out"),
    [
        ("arm.urdf.xacro", '<origin xyz="0 0 ${height}"/>', "arm.urdf"),
        ("arm.xacro", '<xacro:limits of="lift"/>', "arm.urdf"),
        ("arm.urdf", '<limit lower="$(arg low)" upper="1" velocity="1"/>', "arm_expanded.urdf"),
    ],
)
def test_a_xacro_is_told_with_its_command(tmp_path: Path, file: str, inside: str, out: str) -> None:
    path = tmp_path / file
    path.write_text(XACRO.replace("INSIDE", inside))
    with pytest.raises(ConfigurationError) as told:
        machine_file_from_urdf(path)
    assert str(told.value).endswith(f"run: xacro {path} > {tmp_path / out}")
    assert "\n" not in str(told.value)
    path.write_text(XACRO.replace("INSIDE", inside).replace("xmlns:", "was_"))
    with pytest.raises(ConfigurationError, match="run: xacro"):
        machine_file_from_urdf(path)
    path.write_text(XACRO.replace("INSIDE", ""))  # expanded, it keeps its name space
    assert "lift" in machine_file_from_urdf(path)[0]


def chain(*joints: str) -> str:
    """A URDF of sliding joints, each the child of the one before, with what is in them."""
    text = "".join(
        f'<joint name="j{k}" type="{"revolute" if k % 2 else "prismatic"}"><parent link="l{k}"/>'
        f'<child link="l{k + 1}"/><origin xyz="0.3 0.1 {k}" rpy="0.2 0 0.4"/>'
        f'<axis xyz="0 0.6 0.8"/><limit lower="-1" upper="1" velocity="1" effort="1"/>'
        f"{inside}</joint>"
        for k, inside in enumerate(joints)
    )
    links = "".join(f'<link name="l{k}"/>' for k in range(len(joints) + 1))
    return f'<robot name="chain">{links}{text}</robot>'


def test_mimics_follow_with_offset_and_through_others(tmp_path: Path) -> None:
    mimics = (
        "",
        '<mimic joint="j0" multiplier="-2" offset="0.3"/>',
        '<mimic joint="j1" multiplier="0.5" offset="-0.1"/>',
        "",
    )
    text = read(tmp_path, chain(*mimics))
    (tmp_path / "machine.yaml").write_text(text)
    machine = load_machine(tmp_path / "machine.yaml")
    assert machine.joint_names == ("j0", "j3")
    model = pin.buildModelFromXML(chain(*mimics))  # in which they are joints of their own
    data, tip = model.createData(), model.getFrameId("l4")
    for q0, q3 in ((0.0, 0.0), (0.2, -0.5), (-0.7, 0.9)):
        q1 = -2.0 * q0 + 0.3
        pin.framesForwardKinematics(model, data, np.array([q0, q1, 0.5 * q1 - 0.1, q3]))
        (place,) = tip_position(machine, [[q0, q3]])
        np.testing.assert_allclose(place, data.oMf[tip].translation, atol=1e-9)


def test_a_mimic_of_a_joint_elsewhere_is_a_joint_of_its_own(tmp_path: Path) -> None:
    text = read(tmp_path, chain("", '<mimic joint="j2"/>', ""), "l2")
    assert "its leader 'j2', which is not on this arm" in limits_of(tmp_path, "j1", text)[2]
    with pytest.raises(ConfigurationError, match="mimics itself, through 'j0'; correct <mimic>"):
        read(tmp_path, chain('<mimic joint="j1"/>', '<mimic joint="j0"/>'))


INERTIAL = (
    '<inertial><origin xyz="{c}" rpy="0.3 -0.2 0.9"/><mass value="{m}"/>'
    '<inertia ixx="{i}" ixy="0.01" ixz="-0.02" iyy="0.5" iyz="0.03" izz="0.4"/></inertial>'
)


def with_bodies(*inertials: str) -> str:
    """Two moving joints, with a flange fixed to the last link, and a finger that moves beside."""
    text = chain("", "")
    for k, inertial in enumerate(inertials):
        text = text.replace(f'<link name="l{k + 1}"/>', f'<link name="l{k + 1}">{inertial}</link>')
    flange = INERTIAL.format(c="0 0.1 0", m=0.7, i=0.3)
    return text.replace(
        "</robot>",
        f'<link name="flange">{flange}</link><joint name="bolts" type="fixed"><parent link="l2"/>'
        '<child link="flange"/><origin xyz="0.2 0 0.5" rpy="0 1 0.5"/></joint></robot>',
    )


MODEL = """
name: arm
machine: arm.yaml
joints: {j0: m, j1: rad}
terms: [{type: serial_rigid_body}]
"""


def test_bodies_of_links_are_those_of_pinocchio(tmp_path: Path) -> None:
    file = tmp_path / "arm.urdf"
    given = [INERTIAL.format(c="0.1 0.2 -0.3", m=m, i=0.45) for m in (4.0, 2.5)]
    file.write_text(with_bodies(*given))
    bodies = bodies_from_urdf(file)
    assert [body.links for body in bodies] == [("l1",), ("l2", "flange")]
    model = pin.buildModelFromXML(file.read_text())
    for body, theirs in zip(bodies, list(model.inertias)[1:], strict=True):
        np.testing.assert_allclose(body.ten, theirs.toDynamicParameters(), atol=1e-12)
        assert body.known


def test_a_urdf_becomes_a_prior(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """By the command; identify takes the file, and its means are the bodies of the URDF."""
    file = tmp_path / "arm.urdf"
    given = [INERTIAL.format(c="0.1 0.2 -0.3", m=m, i=0.45) for m in (4.0, 2.5)]
    file.write_text(with_bodies(*given))
    prior_path = tmp_path / "prior.yaml"
    assert main(["--urdf", str(file), "--prior", str(prior_path)]) == 0
    assert f"{prior_path}: written; 2 of 2 bodies are known" in capsys.readouterr().out
    (tmp_path / "model.yaml").write_text(MODEL)
    model = load_model(tmp_path / "model.yaml")
    prior = load_prior(prior_path, model)
    assert prior.bodies is not None
    ten = np.concatenate([body.ten for body in bodies_from_urdf(file)])
    theta = model.terms[0].of_bodies(model.setting) @ ten
    np.testing.assert_allclose(prior.matrix @ theta, prior.values, rtol=1e-4, atol=1e-4)


def test_masses_beside_the_arm_are_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Two grippers, of which the arm has one."""
    file = tmp_path / "arm.urdf"
    given = [INERTIAL.format(c="0.1 0.2 -0.3", m=m, i=0.45) for m in (4.0, 2.5)]
    grippers = "".join(
        f'<link name="{name}">{INERTIAL.format(c="0 0 0", m=2.0, i=0.3)}</link>'
        f'<joint name="to_{name}" type="revolute"><parent link="l2"/><child link="{name}"/>'
        '<limit lower="-1" upper="1" velocity="1" effort="1"/></joint>'
        for name in ("left", "right")
    )
    file.write_text(with_bodies(*given).replace("</robot>", f"{grippers}</robot>"))
    for tip, beside in (([], "right (2 kg)"), (["--tip", "l2"], "left (2 kg), right (2 kg)")):
        assert main(["--urdf", str(file), *tip, "--replace"]) == 0
        said = capsys.readouterr().out
        assert f"left out, for other joints than those of the arm move them: {beside};" in said


def test_a_flat_body_can_exist_but_has_no_log_det(tmp_path: Path) -> None:
    """A plate whose moments of inertia add up, but for rounding: 0.1 + 0.2 is not 0.3."""
    file, prior = tmp_path / "arm.urdf", tmp_path / "prior.yaml"
    plate = '<inertial><mass value="2"/><inertia ixx="0.1" iyy="0.3" izz="0.2"/></inertial>'
    file.write_text(with_bodies(plate, INERTIAL.format(c="0 0 0", m=1.0, i=0.45)))
    assert main(["--urdf", str(file), "--prior", str(prior)]) == 0
    assert all(body.known for body in bodies_from_urdf(file))
    assert "measure: gaussian" in prior.read_text()
    (tmp_path / "model.yaml").write_text(MODEL)
    assert load_prior(prior, load_model(tmp_path / "model.yaml")).bodies is None


@pytest.mark.parametrize(
    ("mass", "ixx", "told"),
    [
        (4.0, 1.2, "principal moments of inertia 0.391, 0.508, 1.2 kg m2, of which the largest"),
        (-1.0, 0.45, "a mass of -1 kg, which must be positive; correct <mass>"),
        (0.0, 0.45, "a mass of 0 kg, which must be positive; correct <mass>"),
    ],
)
def test_a_body_that_cannot_exist_is_named_and_left_out(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], mass: float, ixx: float, told: str
) -> None:
    file, prior = tmp_path / "arm.urdf", tmp_path / "prior.yaml"
    wrong = INERTIAL.format(c="0 0 0", m=mass, i=ixx)
    file.write_text(with_bodies(wrong))
    assert main(["--urdf", str(file), "--prior", str(prior)]) == 0
    printed = capsys.readouterr().out
    assert f"{file}: link 'l1': no body has its inertial: {told}" in printed
    assert f"{prior}: written; 1 of 2 bodies are known" in printed
    assert "# MISSING: j0: l1: an inertial that no body has" in prior.read_text()
    (body, _) = bodies_from_urdf(file)
    assert not body.known


def test_a_body_without_numbers_is_refused(tmp_path: Path) -> None:
    file = tmp_path / "arm.urdf"
    file.write_text(with_bodies(INERTIAL.format(c="0 0 0", m="nan", i=1.0)))
    with pytest.raises(ConfigurationError, match="link 'l1': a mass of nan kg .* must be finite"):
        bodies_from_urdf(file)


@pytest.mark.parametrize("encoding", ["utf-16", "iso-8859-1"])
def test_the_encoding_that_a_urdf_states_is_read(encoding: str, tmp_path: Path) -> None:
    text = ARM.replace('name="arm"', 'name="Führung"')
    file = tmp_path / "arm.urdf"
    file.write_bytes(f'<?xml version="1.0" encoding="{encoding}"?>{text}'.encode(encoding))
    assert "name: Führung" in machine_file_from_urdf(file)[0]
