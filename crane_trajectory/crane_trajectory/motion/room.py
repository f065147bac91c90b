"""Room of the tip: its distance from the pillar, and its height above the ground."""

from collections.abc import Sequence

import numpy as np

from crane_model.kinematics import tip_jacobian, tip_position
from crane_model.machine import Machine

SMALL = 1e-9  # m, or sine of an angle
DECIMALS = 12  # of directions, so that axes of the base's frame are exact


class TipRoom:
    """Where the tip of a machine is, seen from the pillar.

    The pillar is the axis of the first joint if that turns about the vertical, which then changes
    nothing; else the vertical through the base. Ahead is where the tip is with all joints in the
    middle of their ranges. The ground is the plane through the base.
    """

    def __init__(self, machine: Machine):
        self._machine = machine
        up = -machine.gravity_vector / machine.gravity
        first, frame = machine.joints[0], machine.base.matrix
        placed = frame @ first.before
        slewing = first.kind == "revolute" and (
            np.linalg.norm(np.cross(placed[:3, :3] @ first.direction, up)) < SMALL
        )
        self.joints = machine.joint_names[1:] if slewing else machine.joint_names
        """Those that move the tip with respect to the pillar."""
        self._foot = (placed if slewing else frame)[:3, 3]
        ranges = [machine.limits[joint] for joint in self.joints]
        middle = np.array([[(one.position_min + one.position_max) / 2 for one in ranges]])
        way = tip_position(machine, self._all_joints(self.joints, middle))[0] - self._foot
        way -= (way @ up) * up
        if np.linalg.norm(way) < SMALL:  # upright: ahead is where the base's frame says
            way = frame[:3, 0] - (frame[:3, 0] @ up) * up
        self._directions = np.round([way / np.linalg.norm(way), up], DECIMALS)

    def at(self, joints: Sequence[str], position: np.ndarray) -> np.ndarray:
        """(n, j) positions of `joints` to (n, 2): distance, positive ahead, and height [m]."""
        tip = tip_position(self._machine, self._all_joints(joints, position))
        return np.stack([(tip - self._foot) @ self._directions[0], tip @ self._directions[1]], 1)

    def slopes(self, joints: Sequence[str], position: np.ndarray) -> np.ndarray:
        """(n, 2, j): derivatives of both with respect to the positions (n, j) of `joints`."""
        jacobian = self._directions @ tip_jacobian(
            self._machine, self._all_joints(joints, position)
        )
        slopes: np.ndarray = jacobian[:, :, [self._machine.index(joint) for joint in joints]]
        slopes[:, :, [joint not in self.joints for joint in joints]] = 0.0
        return slopes

    def _all_joints(self, joints: Sequence[str], position: np.ndarray) -> np.ndarray:
        q = np.zeros((len(position), len(self._machine.joint_names)))
        for joint in self.joints:
            q[:, self._machine.index(joint)] = position[:, joints.index(joint)]
        return q


def tip_room(machine: Machine, joints: Sequence[str], position: np.ndarray) -> np.ndarray:
    """`TipRoom.at` of a machine, for once."""
    return TipRoom(machine).at(joints, position)
