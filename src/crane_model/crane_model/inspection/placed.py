"""Where joints and actuators of a machine stand in space, for pictures."""

from typing import NamedTuple

import numpy as np

from crane_model.array import Array
from crane_model.kinematics import link_transforms
from crane_model.machine import Machine, MachineJoint


class PlacedBar(NamedTuple):
    """A cylinder, or a link, between two pins (3,) in the base's frame [m]."""

    joint: str
    begin: Array
    end: Array
    is_cylinder: bool


def placed_joints(machine: Machine, q: Array) -> Array:
    """(m, 4, 4) of each joint of the chain before it moves, in the base's frame, at q (j,)."""
    links = link_transforms(machine, q)[0]
    before = np.concatenate([machine.base.matrix[None], links[:-1]])
    placed: Array = before @ np.array([joint.before for joint in machine.joints])
    return placed


def placed_bars(machine: Machine, q: Array) -> list[PlacedBar]:
    """What the actuators consist of at q (j,), from the base to the tip."""
    return [
        PlacedBar(
            joint.name,
            _across(joint, frame, bar.begin),
            _across(joint, frame, bar.end),
            bar.is_cylinder,
        )
        for joint, frame in zip(machine.joints, placed_joints(machine, q), strict=True)
        if joint.actuator is not None
        for bar in joint.actuator.bars(q[machine.index(joint.name)])
    ]


def _across(joint: MachineJoint, frame: Array, pin: Array) -> Array:
    """A point (2,) of the plane across the joint's axis in the base's frame (3,)."""
    axis = joint.direction
    x = np.eye(3)[0] - axis[0] * axis
    if np.linalg.norm(x) < 1e-6:  # the joint turns about x: then it is y
        x = np.eye(3)[1] - axis[1] * axis
    x = x / np.linalg.norm(x)
    within = pin[0] * x + pin[1] * np.cross(axis, x)
    place: Array = frame[:3, :3] @ within + frame[:3, 3]
    return place
