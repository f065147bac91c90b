"""Forward kinematics (1)-(2) and the Jacobian: by Pinocchio, by hand, by differentiation."""

import math

import numpy as np
import pinocchio as pin
import pytest
from laboratory_crane import JOINTS
from unit.crane_model.pinocchio_crane import A_2, A_3, D_1, D_40, THETA_20, spatial_crane

from crane_model import Machine, forward_kinematics, tip_jacobian, tip_position
from crane_model.kinematics import link_transforms


def random_coordinates(machine: Machine, count: int) -> np.ndarray:
    limits = [machine.limits[joint] for joint in JOINTS]
    low, high = (
        [getattr(limit, key) for limit in limits] for key in ("position_min", "position_max")
    )
    return np.random.default_rng(3).uniform(low, high, (count, 4))


def test_pose_and_jacobian_of_the_tip_agree_with_pinocchio(machine: Machine) -> None:
    model = spatial_crane()
    data, tip = model.createData(), model.getFrameId("tip")
    q = random_coordinates(machine, 1000)
    poses, jacobians = forward_kinematics(machine, q), tip_jacobian(machine, q)
    for row, pose, jacobian in zip(q, poses, jacobians, strict=True):
        theirs = pin.computeFrameJacobian(model, data, row, tip, pin.LOCAL_WORLD_ALIGNED)
        np.testing.assert_allclose(jacobian, theirs[:3], atol=1e-12)
        np.testing.assert_allclose(pose, data.oMf[tip].homogeneous, atol=1e-12)


def test_every_link_agrees_with_pinocchio(machine: Machine) -> None:
    """Link i's frame is where joint i + 1 turns or slides: T_i^0 with the next joint at zero."""
    model = spatial_crane()
    data = model.createData()
    for row in random_coordinates(machine, 50):
        ours = link_transforms(machine, row)[0]
        for i in range(3):
            held = row.copy()
            held[i + 1 :] = 0.0
            pin.forwardKinematics(model, data, held)
            np.testing.assert_allclose(ours[i], data.oMi[i + 2].homogeneous, atol=1e-12)


def test_transform_of_one_link_is_the_product_of_the_four_in_equation_1(machine: Machine) -> None:
    def rotation(axis: int, angle: float) -> np.ndarray:
        i, k = [(1, 2), (2, 0), (0, 1)][axis]
        matrix = np.eye(4)
        matrix[i, i] = matrix[k, k] = math.cos(angle)
        matrix[i, k], matrix[k, i] = -math.sin(angle), math.sin(angle)
        return matrix

    def translation(axis: int, distance: float) -> np.ndarray:
        matrix = np.eye(4)
        matrix[axis, 3] = distance
        return matrix

    q = np.array([0.3, 0.7, -1.1, 0.4])
    rows = [
        (q[0], D_1, 0.0, math.pi / 2),
        (q[1] + THETA_20, 0.0, A_2, 0.0),
        (math.pi / 2 + q[2] - THETA_20, 0.0, A_3, math.pi / 2),
        (0.0, D_40 + q[3], 0.0, 0.0),
    ]
    expected = np.eye(4)
    for theta, d, a, alpha in rows:
        expected = (
            expected
            @ rotation(2, theta)
            @ translation(2, d)
            @ translation(0, a)
            @ rotation(0, alpha)
        )
    np.testing.assert_allclose(forward_kinematics(machine, q)[0], expected, atol=1e-15)


BY_HAND = {
    # boom line horizontal (phi = 0), telescope axis horizontal (psi = 0)
    "stretched out": (
        [0.0, -THETA_20, THETA_20, 0.0],
        [A_2 + D_40, 0.0, D_1 + A_3],
    ),
    "stretched out to the side, extended": (
        [math.pi / 2, -THETA_20, THETA_20, 1.0],
        [0.0, A_2 + D_40 + 1.0, D_1 + A_3],
    ),
    # boom line upright, telescope hanging straight down: its normal then points outward
    "hanging": (
        [0.0, math.pi / 2 - THETA_20, THETA_20 - math.pi, 0.5],
        [A_3, 0.0, D_1 + A_2 - D_40 - 0.5],
    ),
    # boom line upright, telescope horizontal
    "square": (
        [math.pi, math.pi / 2 - THETA_20, THETA_20 - math.pi / 2, 0.0],
        [-D_40, 0.0, D_1 + A_2 + A_3],
    ),
}


@pytest.mark.parametrize(("q", "tip"), BY_HAND.values(), ids=BY_HAND)
def test_tip_at_postures_computed_by_hand(
    machine: Machine, q: list[float], tip: list[float]
) -> None:
    np.testing.assert_allclose(tip_position(machine, np.array(q))[0], tip, atol=1e-14)


def test_jacobian_is_the_derivative_of_the_position(machine: Machine) -> None:
    q, step = random_coordinates(machine, 100), 1e-5
    jacobian = tip_jacobian(machine, q)
    for i in range(4):
        moved = step * np.eye(4)[i]
        slope = (tip_position(machine, q + moved) - tip_position(machine, q - moved)) / (2 * step)
        np.testing.assert_allclose(jacobian[:, :, i], slope, atol=1e-9)


def test_telescope_slides_along_psi_offset_along_its_normal(machine: Machine) -> None:
    """Design of the plane: tip = elbow + a3 n_psi + (d40 + q4) e_psi, psi = q2 + q3."""
    q = random_coordinates(machine, 100)
    q[:, 0] = 0.0
    phi, psi = q[:, 1] + THETA_20, q[:, 1] + q[:, 2]
    reach = D_40 + q[:, 3]
    x = A_2 * np.cos(phi) - A_3 * np.sin(psi) + reach * np.cos(psi)
    z = D_1 + A_2 * np.sin(phi) + A_3 * np.cos(psi) + reach * np.sin(psi)
    expected = np.stack([x, np.zeros_like(x), z], axis=1)
    np.testing.assert_allclose(tip_position(machine, q), expected, atol=1e-14)
