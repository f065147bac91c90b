"""A URDF as a machine file: its joints in order, and marks where it cannot say what is needed.

The inertials of its links become the bodies of a prior file for `identify`.
"""

import xml.etree.ElementTree as ET
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import yaml

from crane_model.array import Array
from crane_model.chain.body_regressor import pseudo_inertia, ten_about_centre
from crane_model.configuration import MAX_FILE_BYTES
from crane_model.errors import ConfigurationError
from crane_model.joint import about, placement, roll_pitch_yaw

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
PRIOR_HEAD = """\
# From {source}: the bodies of its links in the frames of the machine file made with it, for
# identify --prior. Enter as relative_std_dev how well you know each; measure: log_det or gaussian.
"""
PRIOR_STD_DEV = 0.3  # relative standard deviation of a body, until the user knows better
UNLIMITED_POSITION = 1e3
"""Position [rad, m] from which on a limit is none: the URDF needed some number."""
MOMENT_ROUNDING_SHARE = 1e-9
"""Share of the largest second moment by which rounding may make another negative; a body that has
no more than this is flat."""
KINDS = {"revolute": "revolute", "continuous": "revolute", "prismatic": "prismatic"}


@dataclass(frozen=True)
class ImpossibleBody:
    """An inertial that no distribution of mass has.

    `mass` [kg] and the `principal` moments of inertia (3,) about its centre [kg m2], rising.
    """

    link: str
    mass: float
    principal: Array

    @property
    def excess(self) -> float:
        """How far the largest moment of inertia exceeds the sum of the other two [kg m2]."""
        return float(self.principal[2] - self.principal[0] - self.principal[1])


@dataclass(frozen=True)
class LinkBody:
    """All that a joint moves together: `ten` (10,) of `crane_model.chain` in the joint's frame.

    Of `links`, those that have no body that can exist are `impossible`.
    """

    joint: str
    links: tuple[str, ...]
    ten: Array
    impossible: tuple[ImpossibleBody, ...]

    @property
    def known(self) -> bool:
        """Return whether it has a mass, and all its links can exist."""
        return self.ten[0] > 0.0 and not self.impossible


def machine_file_from_urdf(path: Path, tip: str | None = None) -> tuple[str, int]:
    """Text of a machine file that loads at once, and how many places in it are marked.

    The arm goes from the root to the link `tip`, or to the one with the most moving joints before
    it, and of those to the farthest. `ConfigurationError` if it is no URDF, or has no such arm.
    """
    robot = _read(path)
    arm, tip = _arm(robot, tip, path)
    root = _link(arm[0], "parent", path)
    name = robot.get("name") or path.stem
    every = {joint.get("name", ""): joint for joint in robot.findall("joint")}
    led = {joint.get("name", ""): _led(joint, every, path) for joint in arm if _moves(joint)}
    lines, held = ["joints:\n"], np.eye(4)
    for joint in arm:
        held = held @ _placed(joint, path)
        if _moves(joint):
            lines.append(_entry(joint, held, led, path))
            held = np.eye(4)
    tool = "" if np.allclose(held, np.eye(4)) else f"tool: {_origin(held)}\n"
    text = HEAD.format(source=path.name, root=root, tip=tip, name=_quoted(name), mark=MISSING)
    text += "\n" + "".join(lines) + tool + FOOT.format(mark=MISSING)
    return text, text.count(f"{MISSING}:")


def bodies_from_urdf(path: Path, tip: str | None = None) -> tuple[LinkBody, ...]:
    """Bodies that each joint of the arm moves, with all links that are fixed to it.

    Joints and `tip` are those of `machine_file_from_urdf`; links behind other moving joints are
    left out.
    """
    robot = _read(path)
    arm, _ = _arm(robot, tip, path)
    links = {link.get("name", ""): link for link in robot.findall("link")}
    fixed = [joint for joint in robot.findall("joint") if not _moves(joint)]
    out = []
    for joint in filter(_moves, arm):
        carried, ten, impossible = [(_link(joint, "child", path), np.eye(4))], np.zeros(10), []
        for link, place in carried:  # it grows on the way
            body = _inertial(links.get(link), place, path)
            if isinstance(body, ImpossibleBody):
                impossible.append(body)
            else:
                ten = ten + body
            carried += [
                (_link(following, "child", path), place @ _placed(following, path))
                for following in fixed
                if _link(following, "parent", path) == link
            ]
        names = tuple(link for link, _ in carried)
        out.append(LinkBody(joint.get("name", ""), names, ten, tuple(impossible)))
    return tuple(out)


def masses_beside(path: Path, tip: str | None = None) -> dict[str, float]:
    """Masses [kg] of the links that the bodies leave out: other joints than the arm's move them.

    Joints and `tip` are those of `machine_file_from_urdf`.
    """
    robot = _read(path)
    arm, _ = _arm(robot, tip, path)
    joints = {_link(joint, "child", path): joint for joint in robot.findall("joint")}
    found = {}
    for link in robot.findall("link"):
        name, mass = link.get("name", ""), link.find("inertial/mass")
        beside = any(_moves(joint) and joint not in arm for joint in _way(joints, name, path))
        if beside and mass is not None:
            found[name] = _number(mass, "value", 0.0, f"{path}: link '{name}'")
    return found


def prior_file(bodies: Sequence[LinkBody], source: str) -> str:
    """Text of a prior file for `identify`, in which bodies that are not known are marked."""
    lines, definite = [], True
    for body in bodies:
        if not body.known:
            why = "no inertial" if not body.impossible else "an inertial that no body has"
            lines.append(f"  # {MISSING}: {body.joint}: {', '.join(body.links)}: {why}\n")
            continue
        mass, centre, inertia = ten_about_centre(body.ten)
        second = _second_moments(mass, inertia)
        definite &= bool(second[0] > MOMENT_ROUNDING_SHARE * second[2])
        lines.append(
            f"  {body.joint}: {{mass: {mass:.6g}, centre_of_mass: {_list(centre)},\n"
            f"    inertia: {_list(np.diag(inertia))}, products: "
            f"{_list(inertia[[0, 0, 1], [1, 2, 2]])},\n    relative_std_dev: {PRIOR_STD_DEV}}}\n"
        )
    measure = "log_det" if definite else "gaussian"
    return PRIOR_HEAD.format(source=source) + f"measure: {measure}\nbodies:\n" + "".join(lines)


def _inertial(link: ET.Element | None, place: Array, path: Path) -> Array | ImpossibleBody:
    """The ten parameters (10,) of a link that stands at `place`; zeros if it has no inertial."""
    inertial = None if link is None else link.find("inertial")
    if link is None or inertial is None:
        return np.zeros(10)
    name = link.get("name", "")
    of, zero = f"{path}: link '{name}'", (0.0, 0.0, 0.0)
    origin = inertial.find("origin")
    placed = place @ placement(_triple(origin, "xyz", zero, of), _triple(origin, "rpy", zero, of))
    mass, moments = inertial.find("mass"), inertial.find("inertia")
    kilograms = 0.0 if mass is None else _number(mass, "value", 0.0, of)
    xx, xy, xz, yy, yz, zz = (
        0.0 if moments is None else _number(moments, key, 0.0, of)
        for key in ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
    )
    tensor = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    if not np.isfinite([kilograms, *tensor.flat]).all():
        raise ConfigurationError(
            f"{of}: a mass of {kilograms:g} kg and the inertia {_list(np.diag(tensor))}, which "
            "must be finite; correct <inertial>"
        )
    if kilograms == 0.0 and not tensor.any():
        return np.zeros(10)
    second = _second_moments(kilograms, tensor)
    if not (kilograms > 0.0 and second[0] >= -MOMENT_ROUNDING_SHARE * second[2]):
        return ImpossibleBody(name, kilograms, np.linalg.eigvalsh(tensor))
    turn = placed[:3, :3]
    return _ten(kilograms, placed[:3, 3], turn @ tensor @ turn.T)


def _second_moments(mass: float, inertia: Array) -> Array:
    """(3,) along the principal axes through the centre of mass, rising [kg m2]."""
    second = pseudo_inertia(_ten(mass, np.zeros(3), inertia))[:3, :3]
    return np.linalg.eigvalsh(second).astype(float)


def _ten(mass: float, centre: Array, inertia: Array) -> Array:
    """(10,) of a body with this inertia (3, 3) about its centre of mass (3,)."""
    origin = inertia + mass * (centre @ centre * np.eye(3) - np.outer(centre, centre))
    return np.array([mass, *(mass * centre), *origin[[0, 0, 1, 0, 1, 2], [0, 1, 1, 2, 2, 2]]])


def _arm(robot: ET.Element, tip: str | None, path: Path) -> tuple[list[ET.Element], str]:
    """The joints from the root to the tip, and the tip."""
    found = robot.findall("joint")
    for what, names in {
        "joints are called": [joint.get("name", "") for joint in found],
        "joints lead to link": [_link(joint, "child", path) for joint in found],
    }.items():
        if twice := [name for name in names if names.count(name) > 1]:
            raise ConfigurationError(
                f"{path}: {names.count(twice[0])} {what} '{twice[0]}'; a URDF has one, correct it"
            )
    joints = {_link(joint, "child", path): joint for joint in found}
    links = [link.get("name", "") for link in robot.findall("link")]
    arms = {link: _way(joints, link, path) for link in links}
    if tip is None:
        tip = max(
            links, key=lambda link: (sum(map(_moves, arms[link])), len(arms[link])), default=""
        )
    if tip not in arms or not any(map(_moves, arms[tip])):
        able = [link for link, arm in arms.items() if any(map(_moves, arm))]
        raise ConfigurationError(
            f"{path}: no joint moves link '{tip}'; name one of {', '.join(able) or 'none'} by --tip"
        )
    return arms[tip], tip


def _led(
    joint: ET.Element, every: Mapping[str, ET.Element], path: Path
) -> tuple[str, float, float]:
    """Which joint leads this one, itself if none, with ratio and offset, through all mimics."""
    leader, ratio, offset = joint.get("name", ""), 1.0, 0.0
    passed = {leader}
    while leader in every and (mimic := every[leader].find("mimic")) is not None:
        of = f"{path}: joint '{leader}'"
        offset += ratio * _number(mimic, "offset", 0.0, of)
        ratio *= _number(mimic, "multiplier", 1.0, of)
        leader = mimic.get("joint", "")
        if leader in passed:
            raise ConfigurationError(f"{of}: mimics itself, through '{leader}'; correct <mimic>")
        passed.add(leader)
    return leader, ratio, offset


def _entry(
    joint: ET.Element, place: Array, led: Mapping[str, tuple[str, float, float]], path: Path
) -> str:
    name, kind = joint.get("name", ""), KINDS[joint.get("type", "")]
    if not (name.isidentifier() and name[0].isalpha()):
        raise ConfigurationError(
            f"{path}: joint '{name}': a machine file needs names of letters, digits and _, "
            "a letter first"
        )
    axis = np.array(_triple(joint.find("axis"), "xyz", (1.0, 0.0, 0.0), f"{path}: joint '{name}'"))
    if not axis.any():
        raise ConfigurationError(
            f"{path}: joint '{name}': its <axis> has the length 0, and must have a direction"
        )
    leader, ratio, offset = led[name]
    follows = leader != name and leader in led
    if follows and offset:
        shifted, direction = np.eye(4), axis / np.linalg.norm(axis)
        if kind == "revolute":
            shifted[:3, :3] = about(direction, np.array([offset]))[0]
        else:
            shifted[:3, 3] = offset * direction
        place = place @ shifted
    text = f"  - name: {name}\n    kind: {kind}\n    origin: {_origin(place)}\n"
    text += f"    axis: {_list(axis)}\n"
    if follows:
        return text + f"    follows: {{joint: {leader}, ratio: {ratio!r}}}\n"
    marks = [] if leader == name else [f"its leader '{leader}', which is not on this arm"]
    return text + _limits(joint, marks, path) + ACTUATOR


def _limits(joint: ET.Element, marks: list[str], path: Path) -> str:
    limit, turns = joint.find("limit"), KINDS[joint.get("type", "")] == "revolute"
    of = f"{path}: joint '{joint.get('name')}'"
    low = high = speed = 0.0
    if limit is not None:
        low, high = _number(limit, "lower", 0.0, of), _number(limit, "upper", 0.0, of)
        speed = _number(limit, "velocity", 0.0, of)
    if low > high:
        marks.append(
            f"range of positions, whose limits are swapped (lower {low:g}, upper {high:g})"
        )
        low, high = high, low
    given = (
        joint.get("type") != "continuous" and -UNLIMITED_POSITION < low < high < UNLIMITED_POSITION
    )
    if not given:
        low, high = (-np.pi, np.pi) if turns else (0.0, 1.0)
    if not given or (low, high) == (-np.pi, np.pi):
        marks.append("range of positions")
    if not 0.0 < speed < np.inf:
        speed = 1.0
        marks.append("largest velocities")
    text = f"    limits: {{position_min: {float(low)!r}, position_max: {float(high)!r}, "
    text += f"velocity_min: {-speed!r}, velocity_max: {speed!r}}}"
    return text + (f"   # {MISSING}: {', '.join(marks)}\n" if marks else "\n")


def _read(path: Path) -> ET.Element:
    try:
        if path.stat().st_size > MAX_FILE_BYTES:
            raise ConfigurationError(f"{path}: must have at most {MAX_FILE_BYTES} bytes")
        content = path.read_bytes()
        plain = content.replace(b"\0", b"")  # of UTF-16, too
        if b"<!ENTITY" in plain:
            raise ConfigurationError(f"{path}: entities are not read; write it out first")
        robot = ET.fromstring(content)
    except OSError as error:
        raise ConfigurationError(f"{path}: cannot be read: {error.strerror}") from None
    except (ET.ParseError, LookupError, ValueError) as error:  # ..., or of no known encoding
        if b"<xacro:" in plain:
            raise _not_expanded(path) from None
        raise ConfigurationError(f"{path}: not valid XML: {error}") from None
    read = [
        inner
        for kind in ("link", "joint")
        for element in robot.findall(kind)
        for inner in element.iter()
    ]
    if any(
        "xacro}" in element.tag for element in robot.iter() if isinstance(element.tag, str)
    ) or any(
        "${" in value or "$(" in value
        for element in (robot, *read)
        for value in element.attrib.values()
    ):
        raise _not_expanded(path)
    if robot.tag != "robot":
        raise ConfigurationError(
            f"{path}: no URDF: its root is <{robot.tag}>, not <robot>; a .xacro must be expanded "
            "first (xacro arm.urdf.xacro > arm.urdf)"
        )
    return robot


def _not_expanded(path: Path) -> ConfigurationError:
    plain = path.name.removesuffix(".xacro").removesuffix(".urdf")
    out = path.with_name(f"{plain}.urdf" if path.suffix == ".xacro" else f"{plain}_expanded.urdf")
    return ConfigurationError(
        f"{path}: xacro that is not expanded, which is not a URDF yet; run: xacro {path} > {out}"
    )


def _way(joints: dict[str, ET.Element], link: str, path: Path) -> list[ET.Element]:
    arm: list[ET.Element] = []
    while link in joints:
        arm.insert(0, joints[link])
        link = _link(joints[link], "parent", path)
        if len(arm) > len(joints):
            raise ConfigurationError(f"{path}: the joints at link '{link}' go round in a circle")
    return arm


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
        x = y = z = np.nan
    if not np.isfinite([x, y, z]).all():
        raise ConfigurationError(f"{of}: {key} must be three numbers, got '{given}'")
    return x, y, z


def _number(element: ET.Element, key: str, default: float, of: str) -> float:
    try:
        return float(element.get(key, default))
    except ValueError:
        raise ConfigurationError(
            f"{of}: <{element.tag}>: {key} must be a number, got '{element.get(key)}'"
        ) from None


def _origin(place: Array) -> str:
    angles = np.array(roll_pitch_yaw(place[:3, :3]))
    return f"{{xyz: {_list(place[:3, 3])}, rpy: {_list(angles)}}}"


def _list(values: Array) -> str:
    return "[" + ", ".join(repr(float(f"{value:.15g}") + 0.0) for value in values) + "]"


def _quoted(name: str) -> str:
    return yaml.safe_dump(name, allow_unicode=True).splitlines()[0]
