"""What the bodies of the crane look like: base, pillar, booms, telescope and gripper.

Pins, lengths and cylinder diameters are those of the machine file; the sizes of plates and beams
are drawn to fit a crane of this size. Sideways, from the middle out: cylinder; inner boom; links c2
and c1; cheeks of the outer boom and of the pillar.
"""

import math
from itertools import pairwise

import mujoco
import numpy as np

from crane_model.kinematics import link_transforms
from crane_model.machine import Machine
from crane_sim.drawing.pins import direction, lever_pin, outer_boom_pins, triangle
from crane_sim.drawing.shapes import Disc, Material, bar, box, pin, plate, plates
from crane_sim.parts.mujoco_model import add_body, link_name

PIN = 0.022  # m, radius
BOOM = (0.062, 0.077)  # m from the middle: sides of the inner boom
LINK_2, LINK_1 = (0.080, 0.089), (0.090, 0.099)
CHEEK = (0.101, 0.121)
STEP = 0.006  # m between a cheek and the column under it
FLUSH = 0.0008  # m; overlapping surfaces in one plane would flicker


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
    plate(spec, body, column, STEP - CHEEK[1], CHEEK[1] - STEP)
    cheek = [(0.0, 0.0, 0.095), (*base, 0.06), (-0.09, base[1] - 0.3, 0.04)]
    plates(spec, body, [*cheek, (0.13, base[1] - 0.3, 0.04)], *CHEEK)
    pin(body, (0.0, 0.0), CHEEK[1] + 0.02, 0.045)
    pin(body, base, CHEEK[1] + 0.012, PIN)


def _inner_boom(spec: mujoco.MjSpec, body: mujoco.MjsBody, machine: Machine) -> None:
    """An open-bottomed girder: its cylinder's eye is between the sides, the other above them."""
    length, linkage = machine.as_planar().inner_boom_length, triangle(machine)
    eye = linkage.j2 * direction(linkage.phi_3 - machine.as_planar().theta_2_0)
    base, rocker = (np.array([length, 0.0]) + point for point in outer_boom_pins(machine))
    plates(spec, body, [(0.0, 0.0, 0.07), (*eye, 0.055), (length, 0.0, 0.066)], *BOOM)
    box(body, (0.06, -BOOM[0], 0.045), (length - 0.03, BOOM[0], 0.062), Material.PAINT)
    ear: list[Disc] = [(*base, 0.042), (base[0] - 0.1, 0.055, 0.01), (base[0] + 0.13, 0.055, 0.01)]
    plates(spec, body, ear, BOOM[0] - 0.01, BOOM[1] - 0.008)
    pin(body, eye, BOOM[1] + 0.012, PIN)
    pin(body, base, BOOM[1] + 0.008, PIN)
    pin(body, rocker, LINK_2[1] + 0.004, PIN)


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
    pin(body, lever, CHEEK[1] + 0.012, PIN)
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
    pin(body, (0.0, 0.0), 0.06, PIN)
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
        pin(body, (side * 0.12, -0.375), 0.105, PIN)
        arc = np.linspace(1.05, -1.45, 9)
        centre = np.array([0.0, -0.62])
        path = [centre + np.array([0.29, 0.28]) * direction(angle) for angle in arc]
        widths = np.linspace(0.055, 0.012, 9)
        discs = [(side * x, z, w) for (x, z), w in zip(path, widths, strict=True)]
        for k, ends in enumerate(pairwise(discs)):
            half = 0.014 - k % 2 * FLUSH
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
