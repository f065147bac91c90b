"""A machine as URDF for RViz, Foxglove and `/robot_description`."""

from xml.etree import ElementTree as ET

import numpy as np

from crane_model.array import Array
from crane_model.inspection import travels
from crane_model.joint import roll_pitch_yaw
from crane_model.machine import Machine

_ORANGE, _GREY = "0.95 0.45 0.05 1", "0.3 0.3 0.32 1"
TIP = "tip"
FIRST_LINK_THICKNESS = 0.06  # of an arm's reach: how thick its first link is drawn


def urdf(machine: Machine) -> str:
    """URDF whose joints are the machine's, with their limits, as text.

    Links are named after their joints, their frames are those of `crane_model.chain`.
    """
    robot = ET.Element("robot", name=machine.name.replace(" ", "_"))
    chain = machine.chain
    ends = [*chain.translation[1:], chain.tip_translation]
    reach = float(sum(np.linalg.norm(end) for end in ends)) or 1.0
    base = ET.SubElement(robot, "link", name="base_link")
    _bar(base, np.zeros(3), chain.translation[0], FIRST_LINK_THICKNESS * reach, _GREY)
    parent = "base_link"
    for i, joint in enumerate(machine.joints):
        link = ET.SubElement(robot, "link", name=joint.name)
        width = FIRST_LINK_THICKNESS * reach * (1.0 - 0.6 * i / len(machine.joints))
        _bar(link, np.zeros(3), ends[i], width, _GREY if chain.slides[i] else _ORANGE)
        if i + 1 < len(machine.joints) and chain.slides[i + 1]:  # what the next slides in
            along = chain.rotation[i + 1] @ ends[i + 1]
            _bar(link, ends[i], ends[i] + along, 1.2 * width, _ORANGE)
        _joint(robot, machine, i, parent)
        parent = joint.name
    ET.SubElement(robot, "link", name=TIP)
    fixed = ET.SubElement(robot, "joint", name=f"{TIP}_joint", type="fixed")
    ET.SubElement(fixed, "parent", link=parent)
    ET.SubElement(fixed, "child", link=TIP)
    _origin(fixed, chain.tip_translation, chain.tip_rotation)
    ET.indent(robot)
    return '<?xml version="1.0"?>\n' + ET.tostring(robot, encoding="unicode") + "\n"


def _joint(robot: ET.Element, machine: Machine, i: int, parent: str) -> None:
    joint, chain = machine.joints[i], machine.chain
    element = ET.SubElement(robot, "joint", name=joint.name, type=joint.kind)
    ET.SubElement(element, "parent", link=parent)
    ET.SubElement(element, "child", link=joint.name)
    _origin(element, chain.translation[i], chain.rotation[i])
    ET.SubElement(element, "axis", xyz=_numbers(chain.axis[i]))
    leader = machine.joint_names[chain.leader[i]]
    ratio = float(chain.ratio[i])
    limits = machine.limits[leader]
    low, high = sorted((ratio * limits.position_min, ratio * limits.position_max))
    if joint.follows is not None:
        ET.SubElement(element, "mimic", joint=leader, multiplier=repr(ratio))
    (travel,) = (found for found in travels(machine) if found.joint == leader)
    strengths = [force for force in (travel.up, travel.down) if force is not None]
    ET.SubElement(
        element,
        "limit",
        lower=repr(low),
        upper=repr(high),
        velocity=repr(abs(ratio) * max(-limits.velocity_min, limits.velocity_max)),
        effort=f"{max((np.abs(force).max() for force in strengths), default=0.0):.6g}",
    )


def _bar(link: ET.Element, begin: Array, end: Array, width: float, colour: str) -> None:
    """A box from one point of the link's frame to another, a cube where they are one."""
    along = end - begin
    length = float(np.linalg.norm(along))
    visual = ET.SubElement(link, "visual")
    x = along / length if length > width else np.array([1.0, 0.0, 0.0])
    y = np.cross(np.eye(3)[int(np.argmin(np.abs(x)))], x)
    y = y / np.linalg.norm(y)
    _origin(visual, (begin + end) / 2.0, np.stack([x, y, np.cross(x, y)], axis=1))
    size = np.array([max(length, width), width, width])
    ET.SubElement(ET.SubElement(visual, "geometry"), "box", size=_numbers(size))
    material = ET.SubElement(visual, "material", name="orange" if colour == _ORANGE else "grey")
    ET.SubElement(material, "color", rgba=colour)


def _origin(element: ET.Element, xyz: Array, rotation: Array) -> None:
    rpy = np.array(roll_pitch_yaw(rotation))
    ET.SubElement(element, "origin", xyz=_numbers(xyz), rpy=_numbers(rpy))


def _numbers(values: Array) -> str:
    return " ".join(f"{value + 0.0:.15g}" for value in values)
