"""M, C and G of the planar crane (6), and its energy: another way than the regressor (8)."""

import numpy as np

from crane_model.array import Array
from crane_model.dynamics import Geometry, lagrangian_regressor

LAGRANGIAN_PARAMETERS = (
    "J_FL",
    "S_FL_along",
    "S_FL_normal",
    "J_SL",
    "S_SL_along",
    "S_SL_normal",
    "m_TL",
    "S_TL_along",
    "S_TL_normal",
)


def mass_matrix(geometry: Geometry, parameters: Array, q: Array) -> Array:
    """M(q) of (6): (n, 3) coordinates and the nine parameters to (n, 3, 3)."""
    j_fl, _, _, j_sl, s_sl, n_sl, m_tl, s_tl, n_tl = parameters
    delta, q4 = q[:, 1] - geometry.theta_2_0, q[:, 2]
    a, sin, cos = geometry.inner_boom_length, np.sin(delta), np.cos(delta)
    phi_psi = a * ((s_sl + m_tl * q4) * cos - n_sl * sin)
    psi_psi = j_sl + 2.0 * q4 * s_tl + m_tl * q4**2
    phi_s = a * m_tl * sin
    return _symmetric(
        j_fl + 2.0 * phi_psi + psi_psi,
        phi_psi + psi_psi,
        phi_s - n_tl,
        psi_psi,
        np.full_like(q4, -n_tl),
        np.full_like(q4, m_tl),
    )


def coriolis_matrix(geometry: Geometry, parameters: Array, q: Array, v: Array) -> Array:
    """C(q, v) of (6) by Christoffel symbols, so that dM/dt - 2C is skew: (n, 3) to (n, 3, 3)."""
    _, _, _, _, s_sl, n_sl, m_tl, s_tl, _ = parameters
    delta, q4 = q[:, 1] - geometry.theta_2_0, q[:, 2]
    a, sin, cos = geometry.inner_boom_length, np.sin(delta), np.cos(delta)
    zero = np.zeros_like(q4)
    # M depends on q3 and q4 alone
    phi_psi = -a * ((s_sl + m_tl * q4) * sin + n_sl * cos)
    phi_s = a * m_tl * cos
    by_q3 = _symmetric(2.0 * phi_psi, phi_psi, phi_s, zero, zero, zero)
    phi_psi = a * m_tl * cos
    psi_psi = 2.0 * (s_tl + m_tl * q4)
    by_q4 = _symmetric(2.0 * phi_psi + psi_psi, phi_psi + psi_psi, zero, psi_psi, zero, zero)
    slope = np.stack([np.zeros_like(by_q3), by_q3, by_q4], axis=-1)  # dM_ij / dq_k
    coriolis: Array = 0.5 * (
        np.einsum("nijk,nk->nij", slope, v)
        + np.einsum("nikj,nk->nij", slope, v)
        - np.einsum("njki,nk->nij", slope, v)
    )
    return coriolis


def gravity_vector(geometry: Geometry, parameters: Array, q: Array) -> Array:
    """G(q) = dV/dq of (6): (n, 3) coordinates and the nine parameters to (n, 3)."""
    still = np.zeros_like(q)
    return lagrangian_regressor(geometry, q, still, still) @ parameters


def energy(geometry: Geometry, parameters: Array, q: Array, v: Array) -> tuple[Array, Array]:
    """Kinetic (5) and potential energy [J] at n samples; V is zero at joint 2's height."""
    _, s_fl, n_fl, _, s_sl, n_sl, m_tl, _, _ = parameters
    kinetic = 0.5 * np.einsum("ni,nij,nj->n", v, mass_matrix(geometry, parameters, q), v)
    phi, psi = q[:, 0] + geometry.theta_2_0, q[:, 0] + q[:, 1]
    height = s_fl * np.sin(phi) + n_fl * np.cos(phi)
    height = height + (s_sl + m_tl * q[:, 2]) * np.sin(psi) + n_sl * np.cos(psi)
    return kinetic, geometry.gravity * height


def inverse_dynamics(
    geometry: Geometry, parameters: Array, q: Array, v: Array, acceleration: Array
) -> Array:
    """(n, 3) generalized forces of (6) by M, C and G: the other way round from the regressor."""
    tau: Array = (
        np.einsum("nij,nj->ni", mass_matrix(geometry, parameters, q), acceleration)
        + np.einsum("nij,nj->ni", coriolis_matrix(geometry, parameters, q, v), v)
        + gravity_vector(geometry, parameters, q)
    )
    return tau


def _symmetric(*upper: Array) -> Array:
    """(n, 3, 3) from the upper triangle 11, 12, 13, 22, 23, 33, each (n,)."""
    m11, m12, m13, m22, m23, m33 = upper
    rows = [[m11, m12, m13], [m12, m22, m23], [m13, m23, m33]]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)
