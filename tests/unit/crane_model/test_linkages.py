"""Cylinders (17)-(27): the report's formulas written out, differentiated by complex steps."""

import math

import numpy as np
import pytest
from laboratory_crane import JOINTS, PLANAR_JOINTS
from unit.crane_model.changed_machine import with_actuator

from crane_model import Machine, RangeError, generalized_forces, lever_arms
from crane_model.cylinders import (
    cylinder_force,
    cylinder_forces_from_generalized,
    cylinder_geometry,
    cylinder_length,
    lever_arm,
)

COMPLEX_STEP = 1e-30
LEVER_SIGN = {"slew": 1.0, "inner_boom": 1.0, "outer_boom": -1.0, "telescope": 1.0}


def pin_k(machine: Machine, q3: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Where the links c1 and c2 meet, by intersecting circles; axes at the elbow, x to the pin P.

    Of the two intersections the one on the far side of the line P-R from the elbow, along which
    the linkage moves without a jump.
    """
    k = machine.actuators["outer_boom"]
    gamma_21 = math.pi / 2 - k.beta_1 - q3 + k.gamma_25  # (21)
    p_x, p_y = k.s22, 0.0
    r_x, r_y = k.s23 * np.cos(gamma_21), k.s23 * np.sin(gamma_21)
    s24 = np.sqrt(k.s22**2 + k.s23**2 - 2 * k.s22 * k.s23 * np.cos(gamma_21))  # (22)
    u_x, u_y = (r_x - p_x) / s24, (r_y - p_y) / s24
    along = (s24**2 + k.c1**2 - k.c2**2) / (2 * s24)
    across = np.sqrt(k.c1**2 - along**2)
    return p_x + along * u_x + across * u_y, p_y + along * u_y - across * u_x


def x_of_q(machine: Machine, joint: str, q: np.ndarray) -> np.ndarray:
    """Cylinder length by the formulas of the report, real or complex q."""
    if joint == "slew":
        return 0.08 * q
    if joint == "telescope":
        return q
    if joint == "inner_boom":
        i = machine.actuators["inner_boom"]
        angle = math.pi / 2 - i.phi_4 + i.phi_3 + q
        return np.sqrt(i.j1**2 + i.j2**2 - 2 * i.j1 * i.j2 * np.cos(angle))  # (20)
    k = machine.actuators["outer_boom"]
    k_x, k_y = pin_k(machine, q)
    s33 = np.sqrt(k_x**2 + k_y**2)
    gamma_21 = math.pi / 2 - k.beta_1 - q + k.gamma_25  # (21)
    gamma_32 = math.acos((k.s31**2 + k.s23**2 - k.s32**2) / (2 * k.s31 * k.s23))  # (26)
    gamma_31 = gamma_21 - gamma_32 - np.arccos((s33**2 + k.s22**2 - k.c1**2) / (2 * s33 * k.s22))
    return np.sqrt(s33**2 + k.s31**2 - 2 * k.s31 * s33 * np.cos(gamma_31))  # (25), (24)


def grid(machine: Machine, joint: str) -> np.ndarray:
    limits = machine.limits[joint]
    return np.linspace(limits.position_min, limits.position_max, 2001)


def planar_range(machine: Machine) -> np.ndarray:
    """(2, 3): lower and upper limits of the planar joints."""
    limits = [machine.limits[joint] for joint in PLANAR_JOINTS]
    return np.array([[x.position_min for x in limits], [x.position_max for x in limits]])


@pytest.mark.parametrize("joint", JOINTS)
def test_length_is_the_formula_of_the_report(machine: Machine, joint: str) -> None:
    q = grid(machine, joint)
    np.testing.assert_allclose(
        cylinder_length(machine, joint, q), x_of_q(machine, joint, q), atol=1e-13
    )


@pytest.mark.parametrize("joint", JOINTS)
def test_lever_arm_is_the_derivative_of_the_length(machine: Machine, joint: str) -> None:
    q = grid(machine, joint)
    slope = x_of_q(machine, joint, q + 1j * COMPLEX_STEP).imag / COMPLEX_STEP
    np.testing.assert_allclose(lever_arm(machine, joint, q), slope, atol=1e-12)


@pytest.mark.parametrize("joint", JOINTS)
def test_derivative_of_the_lever_arm(machine: Machine, joint: str) -> None:
    q, step = grid(machine, joint)[1:-1], 1e-3
    slope = np.zeros_like(q)
    for k, weight in ((1, 45.0), (2, -9.0), (3, 1.0)):  # central, sixth order
        ahead, behind = (
            x_of_q(machine, joint, q + sign * k * step + 1j * COMPLEX_STEP).imag / COMPLEX_STEP
            for sign in (1, -1)
        )
        slope += weight * (ahead - behind) / (60.0 * step)
    np.testing.assert_allclose(cylinder_geometry(machine, joint, q)[2], slope, atol=1e-9)


@pytest.mark.parametrize("joint", JOINTS)
def test_lever_arm_keeps_its_sign_over_table_2(machine: Machine, joint: str) -> None:
    assert (LEVER_SIGN[joint] * lever_arm(machine, joint, grid(machine, joint)) > 0.02).all()


@pytest.mark.parametrize("joint", JOINTS)
def test_stroke_suffices_over_table_2(machine: Machine, joint: str) -> None:
    cylinder, x = machine.cylinders[joint], cylinder_length(machine, joint, grid(machine, joint))
    assert cylinder.length_min <= x.min() < x.max() <= cylinder.length_max


def test_four_bar_loop_closes(machine: Machine) -> None:
    """K is at the ends of both links, they meet at gamma_24 of (23), and x runs from K to B."""
    k, q = machine.actuators["outer_boom"], grid(machine, "outer_boom")
    gamma_21 = k.gamma_21_0 - q
    k_x, k_y = pin_k(machine, q)
    to_p = np.stack([k.s22 - k_x, -k_y])
    to_r = np.stack([k.s23 * np.cos(gamma_21) - k_x, k.s23 * np.sin(gamma_21) - k_y])
    np.testing.assert_allclose(np.linalg.norm(to_p, axis=0), k.c1, atol=1e-14)
    np.testing.assert_allclose(np.linalg.norm(to_r, axis=0), k.c2, atol=1e-14)
    s24_squared = k.s22**2 + k.s23**2 - 2 * k.s22 * k.s23 * np.cos(gamma_21)
    gamma_24 = np.arccos((k.c1**2 + k.c2**2 - s24_squared) / (2 * k.c1 * k.c2))  # (23)
    np.testing.assert_allclose(
        np.arccos((to_p * to_r).sum(axis=0) / (k.c1 * k.c2)), gamma_24, atol=1e-13
    )
    to_b = gamma_21 - k.gamma_32
    x = np.hypot(k_x - k.s31 * np.cos(to_b), k_y - k.s31 * np.sin(to_b))
    np.testing.assert_allclose(cylinder_length(machine, "outer_boom", q), x, atol=1e-14)


def test_gamma_32_is_the_angle_between_s31_and_s23(machine: Machine) -> None:
    """Correction of (26): the side opposite the angle at the elbow is s32."""
    k = machine.actuators["outer_boom"]
    b = k.s31 * np.array([np.cos(k.gamma_32), np.sin(k.gamma_32)])
    assert np.linalg.norm(b - [k.s23, 0.0]) == pytest.approx(k.s32, rel=1e-14)


def test_cylinder_force_is_that_of_equation_19(machine: Machine) -> None:
    cylinder = machine.cylinders["telescope"]
    force = cylinder_force(machine, "telescope", np.array([50e5]), np.array([20e5]))
    assert force == pytest.approx(cylinder.area_a * 50e5 - cylinder.area_b * 20e5)


def test_power_of_cylinders_and_joints_balances(machine: Machine) -> None:
    """Virtual work (17)-(18) along a motion: F dx/dt of the cylinder is tau dq/dt of the joint."""
    t = np.linspace(0.0, 1.0, 501)
    middle = planar_range(machine).mean(axis=0)
    swing, rate = np.array([0.8, 1.2, 0.7]), np.array([3.0, 2.0, 5.0])

    def motion(t: np.ndarray) -> np.ndarray:
        return middle + swing * np.sin(rate * t[:, None])

    rng = np.random.default_rng(5)
    p_a, p_b = rng.uniform(0.0, 175e5, (2, len(t), 3))
    tau = generalized_forces(machine, motion(t), p_a, p_b, PLANAR_JOINTS)
    joint_power = tau * swing * rate * np.cos(rate * t[:, None])
    for i, joint in enumerate(PLANAR_JOINTS):
        q = middle[i] + swing[i] * np.sin(rate[i] * (t + 1j * COMPLEX_STEP))
        piston_speed = x_of_q(machine, joint, q).imag / COMPLEX_STEP
        cylinder = machine.cylinders[joint]
        cylinder_power = (cylinder.area_a * p_a[:, i] - cylinder.area_b * p_b[:, i]) * piston_speed
        np.testing.assert_allclose(joint_power[:, i], cylinder_power, rtol=1e-10, atol=1e-8)


def test_generalized_forces_and_back(machine: Machine) -> None:
    """(27) and its inverse; the telescope's force is the cylinder's own."""
    rng = np.random.default_rng(6)
    q = rng.uniform(*planar_range(machine), (500, 3))
    p_a, p_b = rng.uniform(0.0, 175e5, (2, 500, 3))
    force = np.stack(
        [cylinder_force(machine, j, p_a[:, i], p_b[:, i]) for i, j in enumerate(PLANAR_JOINTS)],
        axis=1,
    )
    tau = generalized_forces(machine, q, p_a, p_b, PLANAR_JOINTS)
    np.testing.assert_array_equal(tau[:, 2], force[:, 2])
    back = cylinder_forces_from_generalized(machine, q, tau, PLANAR_JOINTS)
    np.testing.assert_allclose(back, force, rtol=1e-13)
    np.testing.assert_allclose(tau / force, lever_arms(machine, q, PLANAR_JOINTS), rtol=1e-13)


def test_any_shape_of_coordinates_is_kept(machine: Machine) -> None:
    q = np.full((2, 3), -1.0)
    for values in cylinder_geometry(machine, "outer_boom", q):
        assert values.shape == (2, 3)
        assert np.ptp(values) == 0.0


@pytest.fixture
def short_links(machine: Machine) -> Machine:
    """A crane whose outer boom linkage comes apart beyond q3 = 0.35 or so."""
    return with_actuator(machine, "outer_boom", c2=0.36)


def test_linkage_that_cannot_be_assembled_is_out_of_range(short_links: Machine) -> None:
    with pytest.raises(RangeError) as caught:
        cylinder_length(short_links, "outer_boom", np.array([-1.0, 0.45]))
    for part in ("outer_boom", "q = 0.45 rad", "[-2.7, -0.1]"):
        assert part in str(caught.value)


def test_cylinder_of_no_length_is_out_of_range(machine: Machine) -> None:
    update = {"j1": 0.5, "j2": 0.5, "phi_3": 0.0, "phi_4": math.pi / 2}
    degenerate = with_actuator(machine, "inner_boom", **update)
    with pytest.raises(RangeError, match="inner_boom: .* q = 0 rad"):
        lever_arm(degenerate, "inner_boom", np.array([0.5, 0.0]))


@pytest.mark.parametrize("function", [cylinder_length, lever_arm])
@pytest.mark.parametrize("joint", JOINTS)
@pytest.mark.parametrize("value", [math.nan, math.inf])
def test_coordinates_must_be_finite(machine: Machine, function, joint: str, value: float) -> None:
    with pytest.raises(RangeError, match=f"{joint}.*{value}"):
        function(machine, joint, np.array([0.1, value]))


def test_unknown_joint_names_the_joints(machine: Machine) -> None:
    with pytest.raises(RangeError, match=r"'grapple'.*slew, inner_boom, outer_boom, telescope"):
        lever_arm(machine, "grapple", np.zeros(1))
