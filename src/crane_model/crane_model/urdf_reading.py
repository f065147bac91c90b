"""A URDF as a machine file: its joints in order, and marks where it cannot say what is needed."""

import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import yaml

from crane_model.array import Array
from crane_model.configuration import LARGEST_FILE
from crane_model.errors import ConfigurationError
from crane_model.frames import placement, roll_pitch_yaw

MISSING = "MISSING"
HEAD = """\
# From {source}, link {root} to link {tip}. SI units: m, rad, m2, Pa (gauge), m3/s.
# Enter what is marked MISSING; then: ros2 run crane_model machine --check THIS_FILE
name: {name}
gravity: 9.81   # {mark}: straight down along -z of the base? else [x, y, z] in the base's frame
"""
FOOT = """
# {mark}: with hydraulic actuators, what supplies them
# hydraulics: {{supply_pressure: 17.5e+6, relief_pressure: 19.0e+6, tank_pressure: 0.2e+6,
#              pump_flow: 1.2e-3}}
"""
ACTUATOR = (
    "    actuator: {type: passive}   # MISSING: what drives it: triangle_cylinder, "
    "four_bar_cylinder,\n    # direct_cylinder, rack_and_pinion, rotary_motor, electric_drive\n"
)
KINDS = {"revolute": "revolute", "continuous": "revolute", "prismatic": "prismatic"}


def machine_file_from_urdf(path: Path, tip: str | None = None) -> tuple[str, int]:
    """Text of a machine file that loads at once, and how many places in it are marked.

    The arm goes from the root to the link `tip`, or to the one with the most moving joints before
    it, and of those to the farthest. `ConfigurationError` if it is no URDF, or has no such arm.
    """
    robot = _read(path)
    joints = {_link(joint, "child", path): joint for joint in robot.findall("joint")}
    links = [link.get("name", "") for link in robot.findall("link")]
    ways = {link: _way(joints, link, path) for link in links}
    if tip is None:
        tip = max(links, key=lambda one: (sum(map(_moves, ways[one])), len(ways[one])), default="")
    if tip not in ways or not any(map(_moves, ways[tip])):
        able = [link for link, way in ways.items() if any(map(_moves, way))]
        raise ConfigurationError(
            f"{path}: no joint moves link '{tip}'; name one of {', '.join(able) or 'none'} by --tip"
        )
    root = _link(ways[tip][0], "parent", path)
    name = robot.get("name") or path.stem
    lines, held = ["joints:\n"], np.eye(4)
    for joint in ways[tip]:
        held = held @ _placed(joint, path)
        if _moves(joint):
            lines.append(_entry(joint, held, path))
            held = np.eye(4)
    tool = "" if np.allclose(held, np.eye(4)) else f"tool: {_origin(held)}\n"
    text = HEAD.format(source=path.name, root=root, tip=tip, name=_quoted(name), mark=MISSING)
    text += "\n" + "".join(lines) + tool + FOOT.format(mark=MISSING)
    return text, text.count(f"{MISSING}:")


def _entry(joint: ET.Element, place: Array, path: Path) -> str:
    """A joint of the list."""
    name, kind = joint.get("name", ""), joint.get("type", "")
    if not name.isidentifier():
        raise ConfigurationError(
            f"{path}: joint '{name}': a machine file needs names of letters, digits and _"
        )
    axis = _triple(joint.find("axis"), "xyz", (1.0, 0.0, 0.0), f"{path}: joint '{name}'")
    text = f"  - name: {name}\n    kind: {KINDS[kind]}\n    origin: {_origin(place)}\n"
    text += f"    axis: {_list(np.array(axis))}\n"
    mimic = joint.find("mimic")
    if mimic is not None:
        if _number(mimic, "offset", 0.0, path):
            raise ConfigurationError(f"{path}: joint '{name}': a mimic with an offset; shift it")
        ratio = _number(mimic, "multiplier", 1.0, path)
        return text + f"    follows: {{joint: {mimic.get('joint')}, ratio: {ratio!r}}}\n"
    return text + _limits(joint, path) + ACTUATOR


def _limits(joint: ET.Element, path: Path) -> str:
    limit = joint.find("limit")
    marks = []
    low, high = (
        (-np.pi, np.pi)
        if limit is None
        else (_number(limit, "lower", 0.0, path), _number(limit, "upper", 0.0, path))
    )
    if not low < high:
        low, high = -np.pi, np.pi
    if limit is None or joint.get("type") == "continuous" or (low, high) == (-np.pi, np.pi):
        marks.append("range of positions")
    speed = 0.0 if limit is None else _number(limit, "velocity", 0.0, path)
    if not 0.0 < speed < np.inf:
        speed = 1.0
        marks.append("largest velocities")
    text = f"    limits: {{position_min: {float(low)!r}, position_max: {float(high)!r}, "
    text += f"velocity_min: {-speed!r}, velocity_max: {speed!r}}}"
    return text + (f"   # {MISSING}: {', '.join(marks)}\n" if marks else "\n")


def _read(path: Path) -> ET.Element:
    try:
        if path.stat().st_size > LARGEST_FILE:
            raise ConfigurationError(f"{path}: must have at most {LARGEST_FILE} bytes")
        text = path.read_text(encoding="utf-8")
        if "<!ENTITY" in text:
            raise ConfigurationError(f"{path}: entities are not read; write it out first")
        robot = ET.fromstring(text)
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigurationError(f"{path}: cannot be read: {error}") from None
    except ET.ParseError as error:
        raise ConfigurationError(f"{path}: not valid XML: {error}") from None
    if robot.tag != "robot":
        raise ConfigurationError(
            f"{path}: no URDF: its root is <{robot.tag}>, not <robot>; a .xacro must be expanded "
            "first (xacro arm.urdf.xacro > arm.urdf)"
        )
    return robot


def _way(joints: dict[str, ET.Element], link: str, path: Path) -> list[ET.Element]:
    """The joints from the root to a link."""
    way: list[ET.Element] = []
    while link in joints:
        way.insert(0, joints[link])
        link = _link(joints[link], "parent", path)
        if len(way) > len(joints):
            raise ConfigurationError(f"{path}: the joints at link '{link}' go round in a circle")
    return way


def _link(joint: ET.Element, which: str, path: Path) -> str:
    element = joint.find(which)
    if element is None or "link" not in element.attrib:
        raise ConfigurationError(f"{path}: joint '{joint.get('name')}': has no {which} link")
    return element.attrib["link"]


def _moves(joint: ET.Element) -> bool:
    return joint.get("type") != "fixed"


def _placed(joint: ET.Element, path: Path) -> Array:
    kind, name = joint.get("type"), joint.get("name")
    if kind not in (*KINDS, "fixed"):
        raise ConfigurationError(
            f"{path}: joint '{name}': of type {kind}; an arm has revolute, continuous, prismatic "
            "and fixed ones"
        )
    of = f"{path}: joint '{name}'"
    origin = joint.find("origin")
    zero = (0.0, 0.0, 0.0)
    return placement(_triple(origin, "xyz", zero, of), _triple(origin, "rpy", zero, of))


def _triple(
    element: ET.Element | None, key: str, default: tuple[float, float, float], of: str
) -> tuple[float, float, float]:
    given = None if element is None else element.get(key)
    if given is None:
        return default
    try:
        x, y, z = map(float, given.split())
    except ValueError:
        raise ConfigurationError(f"{of}: {key} must be three numbers, got '{given}'") from None
    return x, y, z


def _number(element: ET.Element, key: str, default: float, path: Path) -> float:
    try:
        return float(element.get(key, default))
    except ValueError:
        raise ConfigurationError(
            f"{path}: <{element.tag}>: {key} must be a number, got '{element.get(key)}'"
        ) from None


def _origin(place: Array) -> str:
    angles = np.array(roll_pitch_yaw(place[:3, :3]))
    return f"{{xyz: {_list(place[:3, 3])}, rpy: {_list(angles)}}}"


def _list(values: Array) -> str:
    return "[" + ", ".join(repr(float(f"{value:.15g}") + 0.0) for value in values) + "]"


def _quoted(name: str) -> str:
    return yaml.safe_dump(name, allow_unicode=True).splitlines()[0]
