"""Derivatives of the planar regressor (8) with respect to the motion, summed with weights."""

import numpy as np

from crane_model.array import Array
from crane_model.dynamics import Geometry


def pull_back(geometry: Geometry, q: Array, v: Array, acceleration: Array, weight: Array) -> Array:
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
    # what multiplies A4, A5, B4 + g cos psi and B5 - g sin psi, the mass m_TL (6) at s included
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
    return np.stack([_by_joint(each) for each in (by_position, by_velocity, by_acceleration)])


def _by_joint(slopes: tuple[Array, Array, Array]) -> Array:
    """(n, 3) with respect to q2, q3, q4 from phi, psi, s: phi turns with q2, psi with both."""
    by_phi, by_psi, by_s = slopes
    return np.stack([by_phi + by_psi, by_psi, by_s], axis=1)
