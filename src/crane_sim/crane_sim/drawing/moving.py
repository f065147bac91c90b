"""Parts between two pins: both boom cylinders and the links c1 and c2, and the hanging gripper.

They belong to no body of the crane: each is a body of its own whose place follows from the pins.
"""

import math
from collections.abc import Iterator
from typing import NamedTuple

import mujoco
import numpy as np

from crane_model.machine import Machine
from crane_sim.drawing.bodies import LINK_1, LINK_2, PIN, gripper, radii
from crane_sim.drawing.pins import Pins, four_bar
from crane_sim.drawing.shapes import Material, bar, pin, plate, plates

EYE = 0.034  # m, radius
CAP = 0.08  # m from a cylinder's end to its piston or gland


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
    pin(spec.body("outer_boom_rod"), (0.0, 0.0), LINK_1[1] + 0.008, PIN)
    gripper(spec, _free(spec, "hanging_gripper"))


def placements(pins: Pins) -> Iterator[Placement]:
    """Where each part is, given the pins."""
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
    barrel_end = stroke.length_min - CAP
    rod_end = stroke.length_max - barrel_end + CAP / 2  # still in the barrel when fully extended

    barrel = _free(spec, f"{name}_barrel")
    _eye(spec, barrel)
    bar(barrel, (EYE, 0.0, 0.0), (barrel_end, 0.0, 0.0), outer, Material.BARREL)
    gland = (barrel_end - 0.05, 0.0, 0.0)
    bar(barrel, gland, (barrel_end, 0.0, 0.0), outer + 0.005, Material.STEEL)
    rod = _free(spec, f"{name}_rod")
    _eye(spec, rod)
    bar(rod, (EYE / 2, 0.0, 0.0), (rod_end, 0.0, 0.0), inner, Material.CHROME)


def _eye(spec: mujoco.MjSpec, body: mujoco.MjsBody) -> None:
    plate(spec, body, [(0.0, 0.0, EYE), (EYE, 0.0, EYE * 0.8)], -0.03, 0.03, Material.STEEL)


def _free(spec: mujoco.MjSpec, name: str) -> mujoco.MjsBody:
    return spec.worldbody.add_body(name=name, mocap=True)
