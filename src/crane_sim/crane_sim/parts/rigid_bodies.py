"""Rigid-body dynamics of slew, inner boom, outer boom and telescope from full body parameters.

Derived body by body from the kinetic and potential energy (3)-(6), with no regressor and no base
parameters: the identification is judged against this code, so it shares none with it.

Every body is symmetric to the sagittal plane: its centre of mass lies in that plane and one
principal axis of inertia is normal to it. Points of the plane are (radius from the slew axis,
height). phi = q2 + theta20 is the direction of the inner boom, psi = q2 + q3 that of the telescope.
"""

import math
from typing import NamedTuple

import numpy as np
from numba import njit

PILLAR, INNER_BOOM, OUTER_BOOM, TELESCOPE, GRIPPER = range(5)
BODY = ("mass", "along", "normal", "inertia_along", "inertia_normal", "inertia_plane")
"""Fields of a body's record: kg; centre of mass, m; principal inertia about it, kg m2."""


class Chain(NamedTuple):
    """The crane's geometry and bodies, packed for compiled code.

    `bodies` (5,) are records with the fields of BODY. Their axes "along" and "normal": pillar
    radial and up, at joint 2; inner boom along phi, at joint 2; outer boom along psi, at the elbow;
    telescope and gripper along psi, at the boom tip.
    """

    bodies: np.ndarray
    theta_20: float
    inner_boom_length: float
    telescope_offset: float
    telescope_length: float
    gravity: float


@njit(cache=True, error_model="numpy")
def mass_and_bias(
    chain: Chain, q: np.ndarray, v: np.ndarray, mass: np.ndarray, bias: np.ndarray
) -> None:
    """Fill M(q) (4, 4) and the bias C(q, v) v + G(q) (4,) of (6); q, v in the order of JOINTS."""
    phi, psi = q[1] + chain.theta_20, q[1] + q[2]
    cos_phi, sin_phi, cos_psi, sin_psi = math.cos(phi), math.sin(phi), math.cos(psi), math.sin(psi)
    phi_rate, psi_rate = v[1], v[1] + v[2]
    elbow_r, elbow_z = chain.inner_boom_length * cos_phi, chain.inner_boom_length * sin_phi

    mass[:] = 0.0
    bias[:] = 0.0
    pillar = chain.bodies[PILLAR]
    mass[0, 0] = pillar.mass * pillar.along**2 + pillar.inertia_normal
    # half of dM11/dq2, dM11/dq3, dM11/dq4: what slewing does to the booms, and they to the slew
    half_2 = half_3 = half_4 = 0.0

    # Inner boom: turns about joint 2.
    body = chain.bodies[INNER_BOOM]
    m, along, normal = body.mass, body.along, body.normal
    r = along * cos_phi - normal * sin_phi
    z = along * sin_phi + normal * cos_phi
    mass[0, 0] += m * r * r
    mass[0, 0] += body.inertia_along * sin_phi**2 + body.inertia_normal * cos_phi**2
    half_2 -= m * r * z
    half_2 += (body.inertia_along - body.inertia_normal) * sin_phi * cos_phi
    mass[1, 1] += m * (along * along + normal * normal) + body.inertia_plane
    bias[1] += m * chain.gravity * r

    # Outer boom, telescope and gripper: turn about the elbow, the last two also slide.
    for index in range(OUTER_BOOM, GRIPPER + 1):
        body = chain.bodies[index]
        m, along, normal = body.mass, body.along, body.normal
        slide = 0.0
        if index != OUTER_BOOM:
            slide = 1.0
            along += chain.telescope_length + q[3]
            normal += chain.telescope_offset
        # position from the elbow; turning by 90 degrees is the derivative to psi
        x = along * cos_psi - normal * sin_psi
        y = along * sin_psi + normal * cos_psi
        r = elbow_r + x
        # Jacobian of (radius, height): columns q2, q3, q4
        r_2, z_2 = -elbow_z - y, elbow_r + x
        r_3, z_3 = -y, x
        r_4, z_4 = slide * cos_psi, slide * sin_psi
        # acceleration of the centre of mass at zero joint acceleration, with gravity
        coriolis = 2.0 * slide * v[3] * psi_rate
        a_r = -elbow_r * phi_rate**2 - x * psi_rate**2 - coriolis * sin_psi
        a_z = -elbow_z * phi_rate**2 - y * psi_rate**2 + coriolis * cos_psi + chain.gravity

        twist = (body.inertia_along - body.inertia_normal) * sin_psi * cos_psi
        mass[0, 0] += m * r * r
        mass[0, 0] += body.inertia_along * sin_psi**2 + body.inertia_normal * cos_psi**2
        half_2 += m * r * r_2 + twist
        half_3 += m * r * r_3 + twist
        half_4 += m * r * r_4
        inertia = body.inertia_plane
        mass[1, 1] += m * (r_2 * r_2 + z_2 * z_2) + inertia
        mass[1, 2] += m * (r_2 * r_3 + z_2 * z_3) + inertia
        mass[1, 3] += m * (r_2 * r_4 + z_2 * z_4)
        mass[2, 2] += m * (r_3 * r_3 + z_3 * z_3) + inertia
        mass[2, 3] += m * (r_3 * r_4 + z_3 * z_4)
        mass[3, 3] += m * slide
        bias[1] += m * (r_2 * a_r + z_2 * a_z)
        bias[2] += m * (r_3 * a_r + z_3 * a_z)
        bias[3] += m * (r_4 * a_r + z_4 * a_z)

    mass[2, 1], mass[3, 1], mass[3, 2] = mass[1, 2], mass[1, 3], mass[2, 3]
    bias[0] = 2.0 * v[0] * (half_2 * v[1] + half_3 * v[2] + half_4 * v[3])
    bias[1] -= half_2 * v[0] ** 2
    bias[2] -= half_3 * v[0] ** 2
    bias[3] -= half_4 * v[0] ** 2


def inverse_dynamics(chain: Chain, q: np.ndarray, v: np.ndarray, a: np.ndarray) -> np.ndarray:
    """Generalized forces (4,) of (6) that give the acceleration a (4,) at q, v (4,)."""
    mass, bias = np.empty((4, 4)), np.empty(4)
    mass_and_bias(chain, q, v, mass, bias)
    return mass @ a + bias
