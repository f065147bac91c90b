"""A machine as URDF for RViz, Foxglove and `/robot_description`, and for simulators."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple
from xml.etree import ElementTree as ET

import numpy as np

from crane_model.array import Array
from crane_model.chain.body_regressor import ten_about_centre
from crane_model.inspection import travels
from crane_model.joint import roll_pitch_yaw
from crane_model.machine import Machine

_ORANGE, _GREY = "0.95 0.45 0.05 1", "0.3 0.3 0.32 1"
TIP = "tip"
INERTIA_ROUNDING_SHARE = 1e-12  # of the trace of an inertia, below which a moment is rounding
FIRST_LINK_THICKNESS = 0.06  # of an arm's reach: how thick its first link is drawn


class LinkInertia(NamedTuple):
    """The body of a link, and a comment on where its values come from."""

    ten: Array  # (10,) of `crane_model.chain`, in the frame of its joint
    comment: str


class JointFriction(NamedTuple):
    """Friction of a joint, and a comment on where its values come from."""

    coulomb: float  # N m, N
    viscous: float  # N m s/rad, N s/m
    comment: str


def urdf(
    machine: Machine,
    inertias: Mapping[str, LinkInertia] = {},
    friction: Mapping[str, JointFriction] = {},
    comments: Sequence[str] = (),
) -> str:
    """URDF whose joints are the machine's, with their limits, as text.

    Links are named after their joints, their frames are those of `crane_model.chain`. Links have an
    inertia, and joints friction, if it is given under the name of the joint; `comments` stand at
    the top.
    """
    robot = ET.Element("robot", name=machine.name.replace(" ", "_"))
    for comment in comments:
        robot.append(ET.Comment(f" {comment} "))
    chain = machine.chain
    bars = link_bars(machine)
    base = ET.SubElement(robot, "link", name="base_link")
    _bar(base, np.zeros(3), chain.translation[0], bars[0].width, _GREY)
    parent = "base_link"
    for i, joint in enumerate(machine.joints):
        link = ET.SubElement(robot, "link", name=joint.name)
        end, width = bars[i]
        _bar(link, np.zeros(3), end, width, _GREY if chain.slides[i] else _ORANGE)
        if i + 1 < len(machine.joints) and chain.slides[i + 1]:  # what the next slides in
            along = chain.rotation[i + 1] @ bars[i + 1].end
            _bar(link, end, end + along, 1.2 * width, _ORANGE)
        if joint.name in inertias:
            _inertial(link, inertias[joint.name])
        _joint(robot, machine, i, parent, friction.get(joint.name))
        parent = joint.name
    ET.SubElement(robot, "link", name=TIP)
    fixed = ET.SubElement(robot, "joint", name=f"{TIP}_joint", type="fixed")
    ET.SubElement(fixed, "parent", link=parent)
    ET.SubElement(fixed, "child", link=TIP)
    _origin(fixed, chain.tip_translation, chain.tip_rotation)
    ET.indent(robot)
    return '<?xml version="1.0"?>\n' + ET.tostring(robot, encoding="unicode") + "\n"


class LinkBar(NamedTuple):
    """A link as a bar of square section from the origin of its frame to where the next one is."""

    end: Array  # (3,) m
    width: float  # m


def link_bars(machine: Machine) -> list[LinkBar]:
    """The links of a machine as bars, which become thinner towards the tip."""
    chain = machine.chain
    ends = [*chain.translation[1:], chain.tip_translation]
    reach = float(sum(np.linalg.norm(end) for end in ends)) or 1.0
    widths = FIRST_LINK_THICKNESS * reach * (1.0 - 0.6 * np.arange(len(ends)) / len(ends))
    return [LinkBar(end, float(width)) for end, width in zip(ends, widths, strict=True)]


def _inertial(link: ET.Element, body: LinkInertia) -> None:
    """An inertia about the centre of mass, in axes of the link's frame."""
    link.append(ET.Comment(f" {body.comment} "))
    mass, centre, tensor = ten_about_centre(body.ten)
    tensor = np.where(np.abs(tensor) > INERTIA_ROUNDING_SHARE * np.trace(tensor), tensor, 0.0)
    inertial = ET.SubElement(link, "inertial")
    _origin(inertial, centre.round(12), np.eye(3))
    ET.SubElement(inertial, "mass", value=repr(mass))
    moments = {
        f"i{'xyz'[a]}{'xyz'[b]}": repr(float(tensor[a, b])) for a in range(3) for b in range(a, 3)
    }
    ET.SubElement(inertial, "inertia", moments)


def _joint(
    robot: ET.Element, machine: Machine, i: int, parent: str, friction: JointFriction | None
) -> None:
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
        velocity=repr(abs(ratio) * limits.top_speed),
        effort=f"{max((np.abs(force).max() for force in strengths), default=0.0):.6g}",
    )
    if friction is not None:
        element.append(ET.Comment(f" {friction.comment} "))
        values = {"damping": repr(friction.viscous), "friction": repr(friction.coulomb)}
        ET.SubElement(element, "dynamics", values)


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
