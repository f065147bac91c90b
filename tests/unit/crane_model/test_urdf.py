"""The URDF of a machine, read by Pinocchio, is the machine; and a URDF becomes its file."""

from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np
import pinocchio as pin
import pytest
from laboratory_crane import JOINTS

from crane_model.errors import ConfigurationError
from crane_model.inspection.findings import poses
from crane_model.kinematics import tip_position
from crane_model.machine import Machine, load_machine
from crane_model.urdf import urdf
from crane_model.urdf_reading import MISSING, machine_file_from_urdf

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
    ],
)
def test_what_is_no_arm_is_refused(
    tmp_path: Path, change: tuple[str, str], tip: str | None, told: str
) -> None:
    with pytest.raises(ConfigurationError, match=told):
        read(tmp_path, ARM.replace(*change) if change[0] else ARM, tip)
