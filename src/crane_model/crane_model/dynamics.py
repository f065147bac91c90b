"""Rigid-body dynamics (3)-(9) of the planar crane, linear in its inertial parameters.

Directions phi = q2 + theta20 (inner boom) and psi = q2 + q3 (telescope axis), extension s = q4 and
delta = psi - phi make the Lagrangian (3) linear in nine parameters::

    L = 1/2 J_FL phi'^2 + 1/2 (J_SL + 2 s S_TL + m_TL s^2) psi'^2 + 1/2 m_TL s'^2 - N_TL psi' s'
      + a2 phi' psi' [(S_SL + m_TL s) cos delta - N_SL sin delta] + a2 m_TL phi' s' sin delta
      - g [S_FL sin phi + N_FL cos phi + (S_SL + m_TL s) sin psi + N_SL cos psi]

with J an inertia about joint 2 or the elbow, S a mass moment along the link and N one normal to it:
J_FL and S_FL include what the inner boom carries at the elbow, J_SL, S_SL, N_SL are those of outer
boom, telescope and gripper together at q4 = 0, and m_TL, S_TL, N_TL those of telescope and gripper.
With the centre of mass of telescope and gripper on the telescope's axis, N_TL = a3 m_TL and eight
parameters are left: the base set.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numba import njit

from crane_model.array import Array
from crane_model.machine import Machine

_PLANAR_JOINTS = (0, 1, 2)  # where the joints stand that tau2, tau3 and F4 belong to


class Geometry(NamedTuple):
    """The four constants of Table 1 that the planar dynamics (3)-(9) need."""

    theta_2_0: float  # rad, from q2 to the line from joint 2 to the elbow
    inner_boom_length: float  # m, a2, from joint 2 to the elbow
    telescope_offset: float  # m, a3, along the normal of the telescope's axis
    gravity: float  # m/s2

    @classmethod
    def of(cls, machine: Machine) -> "Geometry":
        """The constants of Table 1 that matter in the plane."""
        crane = machine.as_planar()
        return cls(crane.theta_2_0, crane.inner_boom_length, crane.telescope_offset, crane.gravity)


@njit(cache=True)
def _fill_regressor(
    q: Array,
    v: Array,
    acc: Array,
    at: tuple[int, int, int],
    theta: float,
    a: float,
    g: float,
    normal_per_mass: float,
    out: Array,
) -> None:
    """Write the first columns of the nine, as many as `out` (n, j, 8 or 9) has.

    Inner boom, outer boom and telescope stand at `at` among the j joints of motion and `out`.
    S_TL_normal = normal_per_mass m_TL + what its own column stands for.
    """
    phi_row, psi_row, s_row = np.zeros(9), np.zeros(9), np.zeros(9)
    inner, outer, telescope = at
    for i in range(len(q)):
        phi, psi, s = q[i, inner] + theta, q[i, inner] + q[i, outer], q[i, telescope]
        dphi, dpsi, ds = v[i, inner], v[i, inner] + v[i, outer], v[i, telescope]
        ddphi, ddpsi, dds = acc[i, inner], acc[i, inner] + acc[i, outer], acc[i, telescope]
        sin_phi, cos_phi = np.sin(phi), np.cos(phi)
        sin_psi, cos_psi = np.sin(psi), np.cos(psi)
        # of psi - phi: functions of an angle are what costs most here
        sin_d = sin_psi * cos_phi - cos_psi * sin_phi
        cos_d = cos_psi * cos_phi + sin_psi * sin_phi
        # Euler-Lagrange (4) in (phi, psi, s), parameter by parameter; other entries stay zero
        phi_row[0] = ddphi
        phi_row[1] = g * cos_phi
        phi_row[2] = -g * sin_phi
        psi_row[3] = ddpsi
        phi_row[4] = a * (ddpsi * cos_d - dpsi**2 * sin_d)
        psi_row[4] = a * (ddphi * cos_d + dphi**2 * sin_d) + g * cos_psi
        phi_row[5] = -a * (ddpsi * sin_d + dpsi**2 * cos_d)
        psi_row[5] = -a * (ddphi * sin_d - dphi**2 * cos_d) - g * sin_psi
        phi_row[6] = s * phi_row[4] + a * (2.0 * dpsi * ds * cos_d + dds * sin_d)
        psi_row[6] = s * psi_row[4] + s**2 * ddpsi + 2.0 * s * ds * dpsi
        s_row[6] = dds + a * (ddphi * sin_d - dphi**2 * cos_d) - s * dpsi**2 + g * sin_psi
        psi_row[7] = 2.0 * (s * ddpsi + ds * dpsi)
        s_row[7] = -(dpsi**2)
        psi_row[8] = -dds
        s_row[8] = -ddpsi
        psi_row[6] += normal_per_mass * psi_row[8]
        s_row[6] += normal_per_mass * s_row[8]
        # virtual work: phi turns with q2 alone, psi with q2 and q3
        for k in range(out.shape[2]):
            out[i, inner, k] = phi_row[k] + psi_row[k]
            out[i, outer, k] = psi_row[k]
            out[i, telescope, k] = s_row[k]


def lagrangian_regressor(geometry: Geometry, q: Array, v: Array, acceleration: Array) -> Array:
    """phi of (8) for the nine parameters: (n, 3) motion to (n, 3, 9); rows tau2, tau3, F4.

    The parameters are J_FL, S_FL, N_FL, J_SL, S_SL, N_SL, m_TL, S_TL and N_TL.
    """
    out = np.empty((len(q), 3, 9))
    _fill(geometry, q, v, acceleration, _PLANAR_JOINTS, 0.0, out)
    return out


def fill_base_regressor(
    geometry: Geometry, q: Array, v: Array, acceleration: Array, at: Sequence[int], out: Array
) -> None:
    """Write phi of (8) for the base set, N_TL = a3 m_TL: (n, j) motion into `out` (n, j, 8).

    `at` (3,) says where inner boom, outer boom and telescope stand among the j joints.
    """
    _fill(geometry, q, v, acceleration, at, geometry.telescope_offset, out)


def _fill(
    geometry: Geometry,
    q: Array,
    v: Array,
    acceleration: Array,
    at: Sequence[int],
    normal_per_mass: float,
    out: Array,
) -> None:
    inner, outer, telescope = at
    _fill_regressor(
        np.ascontiguousarray(q, dtype=float),
        np.ascontiguousarray(v, dtype=float),
        np.ascontiguousarray(acceleration, dtype=float),
        (inner, outer, telescope),
        geometry.theta_2_0,
        geometry.inner_boom_length,
        geometry.gravity,
        normal_per_mass,
        out,
    )


# Derivatives of the planar regressor (8) with respect to the motion, summed with weights.


def planar_pull_back(
    geometry: Geometry, q: Array, v: Array, acceleration: Array, weight: Array
) -> Array:
    """(3, n, 3): derivatives of sum_jk weight_njk phi_njk of (8) with respect to (n, 3) motion q,
    q', q'', for the base set, weight (n, 3, 8).

    In the coordinates phi, psi, s of `crane_model.dynamics`; A and B are what the moments of the
    outer boom along (4) and normal (5) to the telescope give in the rows of phi and psi without
    gravity, and they are each other's derivatives with respect to delta.
    """
    a, g = geometry.inner_boom_length, geometry.gravity
    offset = geometry.telescope_offset  # N_TL = a3 m_TL
    q, v, acceleration = q.T, v.T, acceleration.T
    phi, psi, s = q[0] + geometry.theta_2_0, q[0] + q[1], q[2]
    dphi, dpsi, ds = v[0], v[0] + v[1], v[2]
    ddphi, ddpsi, dds = acceleration[0], acceleration[0] + acceleration[1], acceleration[2]
    cos, sin = np.cos(psi - phi), np.sin(psi - phi)
    cos_psi, sin_psi = np.cos(psi), np.sin(psi)
    A4, A5 = a * (ddpsi * cos - dpsi**2 * sin), -a * (ddpsi * sin + dpsi**2 * cos)
    B4, B5 = a * (ddphi * cos + dphi**2 * sin), -a * (ddphi * sin - dphi**2 * cos)
    # virtual work: tau2 belongs to phi and psi, tau3 to psi
    to_phi = weight[:, 0].T
    to_psi = to_phi + weight[:, 1].T
    to_s = weight[:, 2].T
    # factors of A4, A5, B4 + g cos psi and B5 - g sin psi, the mass m_TL (6) at s included
    alpha_4, alpha_5 = to_phi[4] + s * to_phi[6], to_phi[5]
    beta_4, beta_5 = to_psi[4] + s * to_psi[6], to_psi[5] - to_s[6]
    moment = to_psi[7] + s * to_psi[6]
    by_delta = (
        alpha_4 * A5
        - alpha_5 * A4
        + beta_4 * B5
        - beta_5 * B4
        + a * to_phi[6] * (dds * cos - 2.0 * dpsi * ds * sin)
    )
    by_position = (
        -g * (to_phi[1] * np.sin(phi) + to_phi[2] * np.cos(phi)) - by_delta,
        -g * (beta_4 * sin_psi + beta_5 * cos_psi) + by_delta,
        to_phi[6] * A4
        + to_psi[6] * (B4 + g * cos_psi + 2.0 * (s * ddpsi + ds * dpsi))
        - to_s[6] * dpsi**2
        + 2.0 * to_psi[7] * ddpsi,
    )
    by_velocity = (
        2.0 * a * dphi * (beta_4 * sin + beta_5 * cos),
        -2.0 * a * dpsi * (alpha_4 * sin + alpha_5 * cos)
        + 2.0 * a * to_phi[6] * ds * cos
        + 2.0 * moment * ds
        - 2.0 * dpsi * (s * to_s[6] + to_s[7]),
        2.0 * dpsi * (a * to_phi[6] * cos + moment),
    )
    by_acceleration = (
        to_phi[0] + a * (beta_4 * cos - beta_5 * sin),
        to_psi[3]
        + a * (alpha_4 * cos - alpha_5 * sin)
        + s * (moment + to_psi[7])
        - offset * to_s[6],
        a * to_phi[6] * sin - offset * to_psi[6] + to_s[6],
    )
    return np.stack([_by_joint(slopes) for slopes in (by_position, by_velocity, by_acceleration)])


def _by_joint(slopes: tuple[Array, Array, Array]) -> Array:
    """(n, 3) with respect to q2, q3, q4 from phi, psi, s: phi turns with q2, psi with both."""
    by_phi, by_psi, by_s = slopes
    return np.stack([by_phi + by_psi, by_psi, by_s], axis=1)
