"""The crane as URDF for RViz, Foxglove and `/robot_description`."""

import math
from xml.etree import ElementTree as ET

import numpy as np

from crane_model.machine import Machine

_ORANGE, _GREY = "0.95 0.45 0.05 1", "0.3 0.3 0.32 1"


def urdf(machine: Machine) -> str:
    """URDF whose joints are q1 ... q4 of Table 1 with the limits of Table 2, as text."""
    dh = machine.denavit_hartenberg
    robot = ET.Element("robot", name="forwarder_crane")
    half_pi = math.pi / 2

    base = _link(robot, "base_link")
    _box(base, (0.9, 0.9, 0.1), (0.0, 0.0, 0.05), (0.0, 0.0, 0.0), _GREY)
    pillar = _link(robot, "pillar")
    _box(pillar, (0.2, 0.2, dh.base_height), (0, 0, dh.base_height / 2), (0, 0, 0), _ORANGE)
    inner = _link(robot, "inner_boom")
    length = dh.inner_boom_length
    along = (length / 2 * math.cos(dh.theta_2_0), length / 2 * math.sin(dh.theta_2_0), 0.0)
    _box(inner, (length, 0.12, 0.12), along, (0, 0, dh.theta_2_0), _ORANGE)
    outer = _link(robot, "outer_boom")
    rise = dh.telescope_offset
    _box(
        outer,
        (dh.telescope_length, 0.12, 0.12),
        (dh.telescope_length / 2, rise, 0),
        (0, 0, 0),
        _ORANGE,
    )
    telescope = _link(robot, "telescope")
    _box(
        telescope,
        (dh.telescope_length, 0.08, 0.08),
        (-dh.telescope_length / 2, 0, 0),
        (0, 0, 0),
        _GREY,
    )
    _link(robot, "boom_tip")

    # the planar axes are x along the boom, y up, z to the side: turned once at joint 2
    elbow = (length * math.cos(dh.theta_2_0), length * math.sin(dh.theta_2_0), 0.0)
    _joint(robot, machine, "slew", ("base_link", "pillar"), (0, 0, 0), (0, 0, 0), "0 0 1")
    _joint(
        robot,
        machine,
        "inner_boom",
        ("pillar", "inner_boom"),
        (0, 0, dh.base_height),
        (half_pi, 0, 0),
        "0 0 1",
    )
    _joint(robot, machine, "outer_boom", ("inner_boom", "outer_boom"), elbow, (0, 0, 0), "0 0 1")
    _joint(
        robot,
        machine,
        "telescope",
        ("outer_boom", "telescope"),
        (dh.telescope_length, rise, 0),
        (0, 0, 0),
        "1 0 0",
    )
    tip = ET.SubElement(robot, "joint", name="tip", type="fixed")
    ET.SubElement(tip, "parent", link="telescope")
    ET.SubElement(tip, "child", link="boom_tip")
    ET.indent(robot)
    return '<?xml version="1.0"?>\n' + ET.tostring(robot, encoding="unicode") + "\n"


def _link(robot: ET.Element, name: str) -> ET.Element:
    return ET.SubElement(robot, "link", name=name)


def _box(
    link: ET.Element,
    size: tuple[float, float, float],
    centre: tuple[float, float, float],
    turn: tuple[float, float, float],
    colour: str,
) -> None:
    visual = ET.SubElement(link, "visual")
    ET.SubElement(visual, "origin", xyz=_numbers(centre), rpy=_numbers(turn))
    ET.SubElement(ET.SubElement(visual, "geometry"), "box", size=_numbers(size))
    material = ET.SubElement(visual, "material", name="orange" if colour == _ORANGE else "grey")
    ET.SubElement(material, "color", rgba=colour)


def _joint(
    robot: ET.Element,
    machine: Machine,
    name: str,
    links: tuple[str, str],
    origin: tuple[float, float, float],
    turn: tuple[float, float, float],
    axis: str,
) -> None:
    limits, hydraulics = machine.limits[name], machine.hydraulics
    cylinder = machine.cylinders[name]
    kind = "prismatic" if name == "telescope" else "revolute"
    joint = ET.SubElement(robot, "joint", name=name, type=kind)
    ET.SubElement(joint, "parent", link=links[0])
    ET.SubElement(joint, "child", link=links[1])
    ET.SubElement(joint, "origin", xyz=_numbers(origin), rpy=_numbers(turn))
    ET.SubElement(joint, "axis", xyz=axis)
    grid = np.linspace(limits.position_min, limits.position_max, 21)
    lever = max(abs(machine.cylinder(name, grid)[:, 1]))
    ET.SubElement(
        joint,
        "limit",
        lower=repr(limits.position_min),
        upper=repr(limits.position_max),
        velocity=repr(max(-limits.velocity_min, limits.velocity_max)),
        effort=f"{hydraulics.supply_pressure * cylinder.area_a * lever:.6g}",
    )


def _numbers(values: tuple[float, float, float]) -> str:
    return " ".join(f"{value:.10g}" for value in values)
