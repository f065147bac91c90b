"""Frames: rotations and homogeneous transforms (1) from angles, axes and lengths [rad, m]."""

import math
from collections.abc import Sequence

import numpy as np

from crane_model.array import Array


def denavit_hartenberg(
    theta: Array | float, d: Array | float, a: float, alpha: float, n: int
) -> Array:
    """A_i = Rot_z,theta Trans_z,d Trans_x,a Rot_x,alpha (1), (n, 4, 4)."""
    cos, sin = np.cos(theta), np.sin(theta)
    cos_alpha, sin_alpha = np.cos(alpha), np.sin(alpha)
    transform = np.zeros((n, 4, 4))
    transform[:, 0, 0], transform[:, 1, 0] = cos, sin
    transform[:, 0, 1], transform[:, 1, 1] = -sin * cos_alpha, cos * cos_alpha
    transform[:, 0, 2], transform[:, 1, 2] = sin * sin_alpha, -cos * sin_alpha
    transform[:, 2, 1], transform[:, 2, 2] = sin_alpha, cos_alpha
    transform[:, 0, 3], transform[:, 1, 3] = a * cos, a * sin
    transform[:, 2, 3] = d
    transform[:, 3, 3] = 1.0
    return transform


def about(axis: Array, angle: Array) -> Array:
    """Turns of (n,) angles about a unit axis (3,), Rodrigues: (n, 3, 3)."""
    x, y, z = axis
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    sin, cos = np.sin(angle)[:, None, None], np.cos(angle)[:, None, None]
    turned: Array = np.eye(3) + sin * cross + (1.0 - cos) * (cross @ cross)
    return turned


def placement(xyz: Sequence[float], rpy: Sequence[float]) -> Array:
    """(4, 4) of an origin as in URDF: turned about fixed x, then y, then z, and moved by xyz."""
    roll, pitch, yaw = ((math.cos(angle), math.sin(angle)) for angle in rpy)
    turn_x = np.array([[1, 0, 0], [0, roll[0], -roll[1]], [0, roll[1], roll[0]]])
    turn_y = np.array([[pitch[0], 0, pitch[1]], [0, 1, 0], [-pitch[1], 0, pitch[0]]])
    turn_z = np.array([[yaw[0], -yaw[1], 0], [yaw[1], yaw[0], 0], [0, 0, 1]])
    placed = np.eye(4)
    placed[:3, :3] = turn_z @ turn_y @ turn_x
    placed[:3, 3] = xyz
    return placed


def roll_pitch_yaw(rotation: Array) -> tuple[float, float, float]:
    """The angles of `placement` for a rotation (3, 3)."""
    pitch = math.atan2(-rotation[2, 0], math.hypot(rotation[0, 0], rotation[1, 0]))
    if math.hypot(rotation[0, 0], rotation[1, 0]) < 1e-9:  # roll and yaw turn alike: all to roll
        return math.atan2(-rotation[1, 2], rotation[1, 1]), pitch, 0.0
    roll = math.atan2(rotation[2, 1], rotation[2, 2])
    return roll, pitch, math.atan2(rotation[1, 0], rotation[0, 0])
