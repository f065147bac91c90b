"""Forward kinematics (1)-(2) of any machine and the tip's Jacobian, vectorised over samples."""

import numpy as np
from numpy.typing import ArrayLike

from crane_model.array import Array
from crane_model.machine import Machine


def link_transforms(machine: Machine, q: ArrayLike) -> Array:
    """(n, j) generalized coordinates to (n, m, 4, 4): T_1^0 ... T_m^0, products of (1).

    Of each of the m joints of the chain, those that follow others included.
    """
    q = np.atleast_2d(np.asarray(q, dtype=float))
    product = np.broadcast_to(machine.base.matrix, (len(q), 4, 4))
    transforms = np.empty((len(q), len(machine.joints), 4, 4))
    for i, joint in enumerate(machine.joints):
        leader, ratio = machine.led_by(joint)
        product = product @ joint.transform(ratio * q[:, leader])
        transforms[:, i] = product
    return transforms


def forward_kinematics(machine: Machine, q: ArrayLike) -> Array:
    """Pose of the tool in the base frame (2), of any machine.

    Parameters
    ----------
    machine
        The arm of j joints.
    q
        (n, j) or (j,) generalized coordinates, from the base to the tip [rad, m].

    Returns
    -------
    (n, 4, 4) homogeneous transforms.
    """
    transforms: Array = link_transforms(machine, q)[:, -1] @ machine.tool.matrix
    return transforms


def tip_position(machine: Machine, q: ArrayLike) -> Array:
    """Position of the tip in the base frame (2), of any machine.

    Parameters
    ----------
    machine
        The arm of j joints.
    q
        (n, j) or (j,) generalized coordinates, from the base to the tip [rad, m].

    Returns
    -------
    (n, 3) positions [m].

    Examples
    --------
    >>> from crane_model import load_machine
    >>> pose = [[0.0, 0.3, -0.5, 0.2]]  # slew, inner and outer boom [rad], telescope [m]
    >>> distance, across, height = tip_position(load_machine(), pose)[0]
    >>> print(f"{distance:.3f} m from the slew axis, {height:.3f} m high")
    3.272 m from the slew axis, 2.474 m high
    """
    return forward_kinematics(machine, q)[:, :3, 3]


def tip_jacobian(machine: Machine, q: ArrayLike) -> Array:
    """Derivative of the tip's position with respect to the coordinates, of any machine.

    Parameters
    ----------
    machine
        The arm of j joints.
    q
        (n, j) or (j,) generalized coordinates, from the base to the tip [rad, m].

    Returns
    -------
    (n, 3, j) Jacobians [m/rad; 1 where a joint slides].
    """
    transforms = link_transforms(machine, q)
    tip = (transforms[:, -1] @ machine.tool.matrix)[:, :3, 3]
    jacobian = np.zeros((len(transforms), len(machine.joint_names), 3))
    frame = np.broadcast_to(machine.base.matrix, (len(transforms), 4, 4))
    for i, joint in enumerate(machine.joints):
        leader, ratio = machine.led_by(joint)
        placed = frame @ joint.before
        axis = placed[:, :3, :3] @ joint.direction
        along = axis if joint.kind == "prismatic" else np.cross(axis, tip - placed[:, :3, 3])
        jacobian[:, leader] += ratio * along
        frame = transforms[:, i]
    return jacobian.transpose(0, 2, 1)
