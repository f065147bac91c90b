"""The bodies of the crane as drawn: their parts, and the links and cylinders between pins."""

import math
from collections.abc import Iterable, Iterator
from enum import StrEnum
from itertools import pairwise
from typing import NamedTuple

import mujoco
import numpy as np

from crane_model.actuators import (
    DirectCylinder,
    FourBarCylinder,
    TriangleCylinder,
    direction,
    meeting,
)
from crane_model.kinematics import link_transforms
from crane_model.machine import Machine
from crane_sim.parts.mujoco_model import add_body, link_name

# Steel parts to draw with: rounded plates, boxes, round bars; without mass, touching nothing.

Disc = tuple[float, float, float]  # x, z, radius [m]
Point = tuple[float, float, float]  # x, y, z [m]
_CORNERS = np.linspace(0.0, 2.0 * np.pi, 32, endpoint=False)


class Material(StrEnum):
    """Material of parts."""

    PAINT = "paint"
    STEEL = "steel"
    BARREL = "barrel"
    CHROME = "chrome"
    CONCRETE = "concrete"


_LOOK = {  # rgba, specular, shininess
    Material.PAINT: ((0.90, 0.36, 0.04, 1.0), 0.35, 0.55),
    Material.STEEL: ((0.20, 0.21, 0.23, 1.0), 0.40, 0.50),
    Material.BARREL: ((0.13, 0.135, 0.15, 1.0), 0.70, 0.70),
    Material.CHROME: ((0.80, 0.82, 0.85, 1.0), 1.00, 0.90),
    Material.CONCRETE: ((0.55, 0.55, 0.54, 1.0), 0.05, 0.10),
}


def add_materials(spec: mujoco.MjSpec) -> None:
    """Make every `Material` known to the model."""
    for name, (rgba, specular, shininess) in _LOOK.items():
        spec.add_material(name=name, rgba=rgba, specular=specular, shininess=shininess)


def plate(
    spec: mujoco.MjSpec,
    body: mujoco.MjsBody,
    discs: list[Disc],
    low: float,
    high: float,
    material: Material = Material.PAINT,
) -> None:
    """A plate in the plane of x and z, `low` to `high` to the side [m]: the hull of some discs."""
    from scipy.spatial import ConvexHull  # a quarter of a second to import

    circle = np.stack([np.cos(_CORNERS), np.sin(_CORNERS)], axis=1)
    points = np.concatenate([np.array([x, z]) + radius * circle for x, z, radius in discs])
    outline = points[ConvexHull(points).vertices]  # counter-clockwise

    # Corners are repeated for each face, with the face's normal: edges stay sharp.
    corners: list[Point] = []
    normals: list[Point] = []
    faces: list[tuple[int, int, int]] = []

    def face(polygon: list[Point], normal: Point) -> None:
        first = len(corners)
        corners.extend(polygon)
        normals.extend([normal] * len(polygon))
        faces.extend((first, first + k, first + k + 1) for k in range(1, len(polygon) - 1))

    face([(x, low, z) for x, z in outline], (0.0, -1.0, 0.0))
    face([(x, high, z) for x, z in outline[::-1]], (0.0, 1.0, 0.0))
    for (x, z), (to_x, to_z) in zip(outline, np.roll(outline, -1, axis=0), strict=True):
        along = np.array([to_x - x, to_z - z]) / np.hypot(to_x - x, to_z - z)
        rim = [(to_x, low, to_z), (x, low, z), (x, high, z), (to_x, high, to_z)]
        face(rim, (along[1], 0.0, -along[0]))

    mesh = spec.add_mesh(name=f"plate_{len(spec.meshes)}")
    mesh.uservert, mesh.usernormal = np.ravel(corners), np.ravel(normals)
    mesh.userface = mesh.userfacenormal = np.ravel(faces)
    _add(body, mujoco.mjtGeom.mjGEOM_MESH, material, meshname=mesh.name)


def plates(
    spec: mujoco.MjSpec,
    body: mujoco.MjsBody,
    discs: list[Disc],
    inside: float,
    outside: float,
    material: Material = Material.PAINT,
) -> None:
    """The same plate on both sides, each `inside` to `outside` from the middle [m]."""
    plate(spec, body, discs, inside, outside, material)
    plate(spec, body, discs, -outside, -inside, material)


def box(body: mujoco.MjsBody, low: Point, high: Point, material: Material) -> None:
    """A box between two opposite corners."""
    corners = np.array([low, high])
    size, centre = np.diff(corners, axis=0)[0] / 2, corners.mean(axis=0)
    _add(body, mujoco.mjtGeom.mjGEOM_BOX, material, size=size, pos=centre)


def bar(body: mujoco.MjsBody, start: Point, end: Point, radius: float, material: Material) -> None:
    """A round bar."""
    size = (radius, 0.0, 0.0)
    _add(body, mujoco.mjtGeom.mjGEOM_CYLINDER, material, size=size, fromto=(*start, *end))


def pin(body: mujoco.MjsBody, at: Iterable[float], half_width: float, radius: float) -> None:
    """A pin across the plane, at (x, z) of it."""
    x, z = at
    bar(body, (x, -half_width, z), (x, half_width, z), radius, Material.STEEL)


def _add(body: mujoco.MjsBody, kind: mujoco.mjtGeom, material: Material, **shape: object) -> None:
    body.add_geom(type=kind, material=material, mass=0.0, contype=0, conaffinity=0, **shape)


# Pins of both boom linkages: points of the sagittal plane.
#
# Points are (2,) arrays: radius from the slew axis and height [m]. They are constructed from
# lengths and directions, the outer boom's four-bar by intersecting circles, apart from the closed
# forms of `crane_model.linkages`; the distances between them are the cylinder lengths of (20) and
# (24).


class Pins(NamedTuple):
    """The pins in one pose (2,) each; letters as in `crane_model.linkages.outer_boom`."""

    joint_2: np.ndarray
    elbow: np.ndarray  # E
    inner_base: np.ndarray  # of the inner boom's cylinder, on the pillar
    inner_eye: np.ndarray  # and on the boom
    outer_base: np.ndarray  # B: of the outer boom's cylinder, on the inner boom
    outer_eye: np.ndarray  # K: where its eye and both links meet
    lever: np.ndarray  # P: of link c1 on the outer boom
    rocker: np.ndarray  # R: of link c2 on the inner boom
    tip: np.ndarray


def forwarder(machine: Machine) -> bool:
    """Return whether it is a crane as in the paper: a slew, two booms, a telescope."""
    planar = machine.planar
    if planar is None or len(machine.joints) != 1 + len(planar.joints):
        return False
    inner, outer, telescope = (machine.actuators[joint] for joint in planar.joints)
    return (
        isinstance(inner, TriangleCylinder)
        and isinstance(outer, FourBarCylinder)
        and not outer.mirrored
        and isinstance(telescope, DirectCylinder)
    )


def triangle(machine: Machine) -> TriangleCylinder:
    """Linkage that raises the inner boom of a `forwarder`."""
    actuator = machine.actuators[machine.as_planar().joints[0]]
    assert isinstance(actuator, TriangleCylinder)
    return actuator


def four_bar(machine: Machine) -> FourBarCylinder:
    """Linkage that moves the outer boom of a `forwarder`."""
    actuator = machine.actuators[machine.as_planar().joints[1]]
    assert isinstance(actuator, FourBarCylinder)
    return actuator


def outer_boom_pins(machine: Machine, angle: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """Pins B and R seen from the elbow, in axes in which the inner boom's line is at `angle`."""
    linkage = four_bar(machine)
    to_base = angle + math.pi - linkage.pin_rise
    to_rocker = to_base + linkage.gamma_32
    return linkage.s31 * direction(to_base), linkage.s23 * direction(to_rocker)


def lever_pin(machine: Machine, angle: float = 0.0) -> np.ndarray:
    """Pin P seen from the elbow, in axes in which the telescope's direction psi is at `angle`."""
    linkage = four_bar(machine)
    # from P to R the angle at the elbow is gamma_21 (21), and R is fixed to the inner boom
    to_rocker = machine.as_planar().theta_2_0 + math.pi - linkage.pin_rise + linkage.gamma_32
    return linkage.s22 * direction(angle + to_rocker - linkage.gamma_21_0)


def pins(machine: Machine, q: np.ndarray) -> Pins:
    """The pins at q (4,) of a `forwarder`; not finite where the links do not reach."""
    dh, inner, outer = machine.as_planar(), triangle(machine), four_bar(machine)
    phi, psi = q[1] + dh.theta_2_0, q[1] + q[2]
    joint_2 = np.array([0.0, dh.base_height])
    elbow = joint_2 + dh.inner_boom_length * direction(phi)
    base, rocker = (elbow + pin for pin in outer_boom_pins(machine, phi))
    lever = elbow + lever_pin(machine, psi)
    return Pins(
        joint_2=joint_2,
        elbow=elbow,
        inner_base=joint_2 + inner.j1 * direction(inner.phi_4 - math.pi / 2),
        inner_eye=joint_2 + inner.j2 * direction(q[1] + inner.phi_3),
        outer_base=base,
        outer_eye=meeting(lever, outer.c1, rocker, outer.c2),
        lever=lever,
        rocker=rocker,
        tip=elbow
        + dh.telescope_offset * direction(psi + math.pi / 2)
        + (dh.telescope_length + q[3]) * direction(psi),
    )


# Shapes of the bodies of the crane: base, pillar, booms, telescope and gripper.
#
# Pins, lengths and cylinder diameters are those of the machine file; the sizes of plates and beams
# are drawn to fit a crane of this size. Sideways, from the middle out: cylinder; inner boom; links
# c2 and c1; cheeks of the outer boom and of the pillar.

PIN_RADIUS_M = 0.022
INNER_BOOM_SIDES = (0.062, 0.077)  # m from the middle: sides of the inner boom
LINK_2, LINK_1 = (0.080, 0.089), (0.090, 0.099)
CHEEK = (0.101, 0.121)
COLUMN_STEP_M = 0.006  # between a cheek and the column under it
FLUSH_GAP_M = 0.0008  # overlapping surfaces in one plane would flicker


def dress(spec: mujoco.MjSpec, machine: Machine) -> None:
    """Draw the links of a `forwarder`; the gripper is drawn hanging."""
    planar = machine.as_planar()
    inner, outer, telescope = planar.joints
    slew = machine.joint_names[0]
    joint_2 = np.array([0.0, planar.base_height])
    elbow = joint_2 + planar.inner_boom_length * direction(planar.theta_2_0)
    tip = elbow + (planar.telescope_length, planar.telescope_offset)
    _base(spec.worldbody)
    _pillar(spec, _drawn(spec, machine, slew, joint_2, 0.0), machine)
    _inner_boom(spec, _drawn(spec, machine, inner, joint_2, planar.theta_2_0), machine)
    _outer_boom(spec, _drawn(spec, machine, outer, elbow, 0.0), machine)
    _telescope(spec, _drawn(spec, machine, telescope, tip, 0.0), machine)


def _drawn(
    spec: mujoco.MjSpec, machine: Machine, joint: str, at: np.ndarray, angle: float
) -> mujoco.MjsBody:
    """A frame to draw a link in: `at` (x, z) in the zero pose, its x axis raised by `angle`."""
    link = link_transforms(machine, np.zeros(len(machine.joint_names)))[0, machine.index(joint)]
    cos, sin = direction(angle)
    placed = np.eye(4)
    placed[:3, :3] = [[cos, 0.0, -sin], [0.0, 1.0, 0.0], [sin, 0.0, cos]]
    placed[[0, 2], 3] = at
    return add_body(spec.body(link_name(joint)), f"{joint} drawn", np.linalg.inv(link) @ placed)


def _base(world: mujoco.MjsBody) -> None:
    """Foundation with the slew housing and the two racks of the slew drive."""
    box(world, (-0.80, -0.80, 0.0), (0.80, 0.80, 0.06), Material.CONCRETE)
    bar(world, (0.0, 0.0, 0.06), (0.0, 0.0, 0.10), 0.42, Material.STEEL)
    bar(world, (0.0, 0.0, 0.10), (0.0, 0.0, 0.36), 0.27, Material.STEEL)
    for x in (-0.21, 0.21):
        bar(world, (x, -0.50, 0.22), (x, 0.50, 0.22), 0.075, Material.BARREL)
        for y in (-0.50, 0.50):
            bar(world, (x, y - 0.02, 0.22), (x, y + 0.02, 0.22), 0.09, Material.STEEL)
    for angle in np.arange(12) * math.pi / 6:
        x, y = 0.37 * direction(angle)
        bar(world, (x, y, 0.10), (x, y, 0.125), 0.022, Material.CHROME)


def _pillar(spec: mujoco.MjSpec, body: mujoco.MjsBody, machine: Machine) -> None:
    linkage = triangle(machine)
    floor = -machine.as_planar().base_height
    base = linkage.j1 * direction(linkage.phi_4 - math.pi / 2)
    bar(body, (0.0, 0.0, floor + 0.36), (0.0, 0.0, floor + 0.42), 0.24, Material.PAINT)
    column = [(x, z, 0.02) for x, z in _box(-0.17, 0.17, floor + 0.42, floor + 0.5)]
    column += [(x, base[1] - 0.25, 0.02) for x in (-0.11, 0.15)]
    plate(spec, body, column, COLUMN_STEP_M - CHEEK[1], CHEEK[1] - COLUMN_STEP_M)
    cheek = [(0.0, 0.0, 0.095), (*base, 0.06), (-0.09, base[1] - 0.3, 0.04)]
    plates(spec, body, [*cheek, (0.13, base[1] - 0.3, 0.04)], *CHEEK)
    pin(body, (0.0, 0.0), CHEEK[1] + 0.02, 0.045)
    pin(body, base, CHEEK[1] + 0.012, PIN_RADIUS_M)


def _inner_boom(spec: mujoco.MjSpec, body: mujoco.MjsBody, machine: Machine) -> None:
    """An open-bottomed girder: its cylinder's eye is between the sides, the other above them."""
    length, linkage = machine.as_planar().inner_boom_length, triangle(machine)
    eye = linkage.j2 * direction(linkage.phi_3 - machine.as_planar().theta_2_0)
    base, rocker = (np.array([length, 0.0]) + point for point in outer_boom_pins(machine))
    plates(spec, body, [(0.0, 0.0, 0.07), (*eye, 0.055), (length, 0.0, 0.066)], *INNER_BOOM_SIDES)
    box(
        body,
        (0.06, -INNER_BOOM_SIDES[0], 0.045),
        (length - 0.03, INNER_BOOM_SIDES[0], 0.062),
        Material.PAINT,
    )
    ear: list[Disc] = [(*base, 0.042), (base[0] - 0.1, 0.055, 0.01), (base[0] + 0.13, 0.055, 0.01)]
    plates(spec, body, ear, INNER_BOOM_SIDES[0] - 0.01, INNER_BOOM_SIDES[1] - 0.008)
    pin(body, eye, INNER_BOOM_SIDES[1] + 0.012, PIN_RADIUS_M)
    pin(body, base, INNER_BOOM_SIDES[1] + 0.008, PIN_RADIUS_M)
    pin(body, rocker, LINK_2[1] + 0.004, PIN_RADIUS_M)


def _outer_boom(spec: mujoco.MjSpec, body: mujoco.MjsBody, machine: Machine) -> None:
    """A square tube along the telescope's axis, on cheeks that straddle the inner boom."""
    dh = machine.as_planar()
    rise, end, lever = dh.telescope_offset, dh.telescope_length - 0.17, lever_pin(machine)
    tube = [(x, z, 0.008) for x, z in _box(0.10, end, rise - 0.08, rise + 0.08)]
    plate(spec, body, tube, -0.066, 0.066)
    collar = [(x, z, 0.008) for x, z in _box(end - 0.07, end, rise - 0.092, rise + 0.092)]
    plate(spec, body, collar, -0.078, 0.078)
    cheek = [(0.0, 0.0, 0.072), (*lever, 0.045), (0.38, rise - 0.02, 0.05), (0.30, rise, 0.07)]
    plates(spec, body, cheek, *CHEEK)
    plate(spec, body, [(0.17, rise, 0.05), (0.36, rise, 0.04)], -CHEEK[0], CHEEK[0])
    pin(body, (0.0, 0.0), CHEEK[1] + 0.02, 0.04)
    pin(body, lever, CHEEK[1] + 0.012, PIN_RADIUS_M)
    radius, _ = radii(machine, machine.as_planar().joints[2])
    height = rise + _above_tube(machine)
    bar(body, (-0.02, 0.0, height), (end + 0.015, 0.0, height), radius, Material.BARREL)
    for x in (0.14, end - 0.03):
        box(body, (x, -0.03, rise + 0.07), (x + 0.03, 0.03, height + 0.5 * radius), Material.PAINT)


def _telescope(spec: mujoco.MjSpec, body: mujoco.MjsBody, machine: Machine) -> None:
    """A tube within the outer boom's, with the fork that carries the gripper, and the rod."""
    length = machine.as_planar().telescope_length
    tube = [(x, z, 0.006) for x, z in _box(0.14 - length, -0.07, -0.06, 0.06)]
    plate(spec, body, tube, -0.048, 0.048, Material.STEEL)
    plates(spec, body, [(-0.12, 0.0, 0.05), (0.0, 0.0, 0.04)], 0.032, 0.05, Material.STEEL)
    pin(body, (0.0, 0.0), 0.06, PIN_RADIUS_M)
    _, radius = radii(machine, machine.as_planar().joints[2])
    height = _above_tube(machine)
    plate(spec, body, [(-0.10, 0.0, 0.05), (-0.10, height, 0.03)], -0.03, 0.03, Material.STEEL)
    bar(body, (0.14 - length, 0.0, height), (-0.10, 0.0, height), radius, Material.CHROME)


def gripper(spec: mujoco.MjSpec, body: mujoco.MjsBody) -> None:
    """Link, rotator and jaws, hanging from the origin of `body`."""
    plate(spec, body, [(0.0, 0.0, 0.035), (0.0, -0.17, 0.035)], -0.028, 0.028, Material.STEEL)
    bar(body, (0.0, 0.0, -0.17), (0.0, 0.0, -0.30), 0.075, Material.BARREL)
    bar(body, (0.0, 0.0, -0.19), (0.0, 0.0, -0.21), 0.09, Material.STEEL)
    head = [(x, z, 0.02) for x, z in _box(-0.15, 0.15, -0.40, -0.32)]
    plates(spec, body, head, 0.07, 0.09)
    box(body, (-0.13, -0.07, -0.335), (0.13, 0.07, -0.30), Material.PAINT)
    bar(body, (-0.16, 0.0, -0.47), (0.03, 0.0, -0.47), 0.03, Material.BARREL)
    bar(body, (0.0, 0.0, -0.47), (0.16, 0.0, -0.47), 0.016, Material.CHROME)
    for side, middle in ((-1.0, 0.045), (1.0, 0.1)):
        pin(body, (side * 0.12, -0.375), 0.105, PIN_RADIUS_M)
        arc = np.linspace(1.05, -1.45, 9)
        centre = np.array([0.0, -0.62])
        path = [centre + np.array([0.29, 0.28]) * direction(angle) for angle in arc]
        widths = np.linspace(0.055, 0.012, 9)
        discs = [(side * x, z, w) for (x, z), w in zip(path, widths, strict=True)]
        for k, ends in enumerate(pairwise(discs)):
            half = 0.014 - k % 2 * FLUSH_GAP_M
            plates(spec, body, list(ends), middle - half, middle + half)
        bar(
            body,
            (discs[4][0], -middle, discs[4][1]),
            (discs[4][0], middle, discs[4][1]),
            0.016,
            Material.STEEL,
        )


def radii(machine: Machine, joint: str) -> tuple[float, float]:
    """Outer radius of a cylinder's barrel, and radius of its rod [m]: from its two areas."""
    cylinder = machine.cylinders[joint]
    wall = 0.009
    return (
        math.sqrt(cylinder.area_a / math.pi) + wall,
        math.sqrt(max(cylinder.area_a - cylinder.area_b, 1e-4) / math.pi),
    )


def _above_tube(machine: Machine) -> float:
    """Height of the telescope's cylinder over the telescope's axis."""
    return 0.092 + 0.008 + radii(machine, machine.as_planar().joints[2])[0]


def _box(low_x: float, high_x: float, low_z: float, high_z: float) -> list[tuple[float, float]]:
    return [(x, z) for x in (low_x, high_x) for z in (low_z, high_z)]


# Parts between two pins: both boom cylinders and the links c1 and c2, and the hanging gripper.
#
# They belong to no body of the crane: each is a body of its own whose place follows from the pins.

EYE_RADIUS_M = 0.034
CAP_LENGTH_M = 0.08  # from a cylinder's end to its piston or gland


class Placement(NamedTuple):
    """A part's origin in the sagittal plane and how far its x axis is raised [m, rad]."""

    name: str
    origin: np.ndarray
    angle: float


def add_moving_parts(spec: mujoco.MjSpec, machine: Machine) -> None:
    """Bodies to be placed by `placements`."""
    inner, outer, _ = machine.as_planar().joints
    _cylinder(spec, machine, inner, "inner_boom")
    _cylinder(spec, machine, outer, "outer_boom")
    linkage = four_bar(machine)
    for name, length, sides in (("link_1", linkage.c1, LINK_1), ("link_2", linkage.c2, LINK_2)):
        body = _free(spec, name)
        discs = [(0.0, 0.0, 0.034), (length, 0.0, 0.034)]
        plates(spec, body, discs, *sides, material=Material.STEEL)
    # one pin through both links and the cylinder's eye
    pin(spec.body("outer_boom_rod"), (0.0, 0.0), LINK_1[1] + 0.008, PIN_RADIUS_M)
    gripper(spec, _free(spec, "hanging_gripper"))


def placements(pins: Pins) -> Iterator[Placement]:
    """Placement of each part, given the pins."""
    yield _between("inner_boom_barrel", pins.inner_base, pins.inner_eye)
    yield _between("inner_boom_rod", pins.inner_eye, pins.inner_base)
    yield _between("outer_boom_barrel", pins.outer_base, pins.outer_eye)
    yield _between("outer_boom_rod", pins.outer_eye, pins.outer_base)
    yield _between("link_1", pins.lever, pins.outer_eye)
    yield _between("link_2", pins.rocker, pins.outer_eye)
    yield Placement("hanging_gripper", pins.tip, 0.0)


def _between(name: str, start: np.ndarray, end: np.ndarray) -> Placement:
    x, z = end - start
    return Placement(name, start, math.atan2(z, x))


def _cylinder(spec: mujoco.MjSpec, machine: Machine, joint: str, name: str) -> None:
    """Barrel from its pin, rod from the other; neither runs out of its stroke."""
    stroke = machine.cylinders[joint]
    outer, inner = radii(machine, joint)
    barrel_end = stroke.length_min - CAP_LENGTH_M
    rod_end = (
        stroke.length_max - barrel_end + CAP_LENGTH_M / 2
    )  # still in the barrel when fully extended

    barrel = _free(spec, f"{name}_barrel")
    _eye(spec, barrel)
    bar(barrel, (EYE_RADIUS_M, 0.0, 0.0), (barrel_end, 0.0, 0.0), outer, Material.BARREL)
    gland = (barrel_end - 0.05, 0.0, 0.0)
    bar(barrel, gland, (barrel_end, 0.0, 0.0), outer + 0.005, Material.STEEL)
    rod = _free(spec, f"{name}_rod")
    _eye(spec, rod)
    bar(rod, (EYE_RADIUS_M / 2, 0.0, 0.0), (rod_end, 0.0, 0.0), inner, Material.CHROME)


def _eye(spec: mujoco.MjSpec, body: mujoco.MjsBody) -> None:
    plate(
        spec,
        body,
        [(0.0, 0.0, EYE_RADIUS_M), (EYE_RADIUS_M, 0.0, EYE_RADIUS_M * 0.8)],
        -0.03,
        0.03,
        Material.STEEL,
    )


def _free(spec: mujoco.MjSpec, name: str) -> mujoco.MjsBody:
    return spec.worldbody.add_body(name=name, mocap=True)
