"""Forward kinematics (1)-(2) of all four joints and the tip's Jacobian, vectorised over samples."""

import numpy as np
from numpy.typing import ArrayLike

from crane_model.array import Array
from crane_model.machine import Machine


def link_transforms(machine: Machine, q: ArrayLike) -> Array:
    """(n, 4) generalized coordinates to (n, 4, 4, 4): T_1^0 ... T_4^0, products of (1)."""
    q = np.atleast_2d(np.asarray(q, dtype=float))
    table = machine.denavit_hartenberg.table
    product = np.broadcast_to(np.eye(4), (len(q), 4, 4))
    transforms = np.empty((len(q), 4, 4, 4))
    for i, (theta_0, d_0, a, alpha) in enumerate(table):
        prismatic = i == 3
        theta = theta_0 + (0.0 if prismatic else q[:, i])
        d = d_0 + (q[:, i] if prismatic else 0.0)
        product = product @ _denavit_hartenberg(theta, d, a, alpha, len(q))
        transforms[:, i] = product
    return transforms


def forward_kinematics(machine: Machine, q: ArrayLike) -> Array:
    """(n, 4) generalized coordinates to (n, 4, 4): T_4^0 (2)."""
    return link_transforms(machine, q)[:, 3]


def tip_position(machine: Machine, q: ArrayLike) -> Array:
    """(n, 4) generalized coordinates to (n, 3): boom tip in the base frame (2) [m].

    >>> from crane_model import load_machine
    >>> pose = [[0.0, 0.3, -0.5, 0.2]]  # slew, inner and outer boom [rad], telescope [m]
    >>> distance, across, height = tip_position(load_machine(), pose)[0]
    >>> print(f"{distance:.3f} m from the slew axis, {height:.3f} m high")
    3.272 m from the slew axis, 2.474 m high
    """
    return forward_kinematics(machine, q)[:, :3, 3]


def tip_jacobian(machine: Machine, q: ArrayLike) -> Array:
    """(n, 4) generalized coordinates to (n, 3, 4): d tip / d q [m/rad; 1 for the telescope]."""
    transforms = link_transforms(machine, q)
    n = len(transforms)
    tip = transforms[:, 3, :3, 3]
    frames = np.concatenate([np.broadcast_to(np.eye(4), (n, 1, 4, 4)), transforms[:, :3]], axis=1)
    axes, origins = frames[:, :, :3, 2], frames[:, :, :3, 3]
    jacobian = np.cross(axes, tip[:, None, :] - origins)
    jacobian[:, 3] = axes[:, 3]
    return jacobian.transpose(0, 2, 1)


def _denavit_hartenberg(
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
