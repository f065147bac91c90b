"""Any machine, drawn simply: a bar from each joint to the next, and a pin where one turns."""

import mujoco
import numpy as np

from crane_model.kinematics import forward_kinematics, link_transforms
from crane_model.machine import Machine
from crane_sim.drawing.shapes import Material, bar
from crane_sim.parts.mujoco_model import link_name

THICKEST, THINNER = 0.09, 0.85  # m, radius of the first link; and of each next one, its share
PIN = 1.6  # length of a pin to either side, of the radius of its link
SHORTEST = 0.02  # m, of a bar that is drawn


def sketch(spec: mujoco.MjSpec, machine: Machine) -> None:
    """Draw the links of `machine_spec`, and the base."""
    still = np.zeros(len(machine.joint_names))
    frames = link_transforms(machine, still)[0]
    before = [machine.base.matrix, *frames[:-1]]
    joints = [frame @ one.before for frame, one in zip(before, machine.joints, strict=True)]
    ends = [*(placed[:3, 3] for placed in joints[1:]), forward_kinematics(machine, still)[0, :3, 3]]
    bar(spec.worldbody, (0.0, 0.0, 0.0), (0.0, 0.0, 0.05), 2.5 * THICKEST, Material.CONCRETE)
    _bar(spec.worldbody, np.zeros(3), joints[0][:3, 3], THICKEST, Material.STEEL)
    for i, joint in enumerate(machine.joints):
        link, seen = spec.body(link_name(joint.name)), np.linalg.inv(frames[i])
        radius, slides = THICKEST * THINNER ** (i + 1), joint.kind == "prismatic"
        start, end = _point(seen, joints[i][:3, 3]), _point(seen, ends[i])
        _bar(link, start, end, radius, Material.CHROME if slides else Material.PAINT)
        if not slides:
            half = PIN * radius * (seen[:3, :3] @ joints[i][:3, :3] @ joint.direction)
            _bar(link, start - half, start + half, radius, Material.STEEL)


def _point(seen: np.ndarray, point: np.ndarray) -> np.ndarray:
    """(3,) in another frame."""
    placed: np.ndarray = seen[:3, :3] @ point + seen[:3, 3]
    return placed


def _bar(
    body: mujoco.MjsBody, start: np.ndarray, end: np.ndarray, radius: float, material: Material
) -> None:
    if np.linalg.norm(end - start) > SHORTEST:
        bar(body, (start[0], start[1], start[2]), (end[0], end[1], end[2]), radius, material)
