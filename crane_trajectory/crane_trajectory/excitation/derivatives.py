"""Derivatives of regressor columns with respect to the motion, summed with weights.

Every criterion of (35) is a function of Phi^T Phi. Its derivative with respect to the motion is
sum_jk weight_njk dPhi_njk / d(q, q', q'') at each sample n: the regressor pulled back by a weight.
Closed forms for the terms of the report's model (16); for any other term of one instant,
differences of fourth order, which are exact to rounding where the term is smooth.
"""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from crane_model.dynamics import Geometry
from crane_model.errors import ConfigurationError
from crane_model.model_file import Model
from crane_model.record import Record
from crane_model.terms import Setting, Term
from crane_model.terms.planar import planar_columns
from crane_trajectory.motion.fourier import MotionSamples

STEP = 1e-3  # rad, m and their derivatives: rounding and truncation of the stencil are alike
STENCIL = ((-2, 1 / 12), (-1, -2 / 3), (1, 2 / 3), (2, -1 / 12))


def smooth_record(model: Model, motion: MotionSamples, width: np.ndarray) -> Record:
    """Samples (n, j) as the model takes them, with tanh(q' / width) for sgn(q'); width (j,)."""
    return Record(
        joints=model.joints,
        time=np.arange(len(motion.position), dtype=float),
        position=motion.position,
        velocity=motion.velocity,
        acceleration=motion.acceleration,
        direction_known=np.tanh(motion.velocity / width),
    )


def smooth_regressor(model: Model, record: Record) -> np.ndarray:
    """Phi (n, j, p) on a `smooth_record`, with q' tanh(q' / width) for |q'| as well."""
    regressor = np.zeros((*record.position.shape, len(model.parameters)))
    for term, columns in _parts(model):
        term.fill_smooth(record, model.setting, regressor[:, :, columns])
    return regressor


def pull_back(model: Model, record: Record, weight: np.ndarray, width: np.ndarray) -> MotionSamples:
    """sum_jk weight_njk dPhi_njk / d(q, q', q'') of `smooth_regressor`: three arrays (n, j).

    weight (n, j, p); `record` is one of `smooth_record` with the same `width`. Raises
    `ConfigurationError` for a term whose force depends on more than the motion at the instant.
    """
    total = MotionSamples(*np.zeros((3, *record.position.shape)))
    for term, columns in _parts(model):
        if term.has_base_parameters:
            assert model.machine is not None  # such a model cannot be loaded
            geometry = Geometry.of(model.machine)
            at = planar_columns(model.setting, record)
            parts = _rigid_body(geometry, record, at, weight[:, at, columns])
            for whole, part in zip(total, parts, strict=True):
                whole[:, at] += part
            continue
        if not term.of_one_instant:
            raise ConfigurationError(
                f"model '{model.name}': term '{term.type}' depends on more than the motion at one "
                "instant; leave it out of the model for which a trajectory is designed"
            )
        own = range(len(width)) if term.only_joint is None else [record.column(term.only_joint)]
        for j in own:
            slopes = term.slopes(record, j, (1.0 - record.direction[:, j] ** 2) / width[j])
            if slopes is None:
                given = weight[:, :, columns]
                slopes = _by_differences(term, model.setting, record, j, width[j], given)
            else:
                slopes = weight[:, j, columns.start] * slopes
            for whole, part in zip(total, slopes, strict=True):
                whole[:, j] += part
    return total


def _parts(model: Model) -> Iterator[tuple[Term, slice]]:
    """Every term with its columns of the regressor."""
    end = 0
    for term in model.terms:
        start, end = end, end + len(term.parameters(model.setting))
        yield term, slice(start, end)


def _by_differences(
    term: Term, setting: Setting, record: Record, j: int, width: float, weight: np.ndarray
) -> np.ndarray:
    """(3, n): derivatives with respect to q, q' and q'' of joint j of the columns of a term,
    summed with weights (n, j, p).
    """

    def weighted(quantity: str, shift: float) -> np.ndarray:
        shifted = getattr(record, quantity).copy()
        shifted[:, j] += shift
        moved = {quantity: shifted}
        if quantity == "velocity":
            moved["direction_known"] = record.direction.copy()
            moved["direction_known"][:, j] = np.tanh(shifted[:, j] / width)
        columns = term.columns(replace(record, **moved), setting)
        total: np.ndarray = np.einsum("njp,njp->n", weight, columns)
        return total

    return np.stack(
        [
            np.sum([factor * weighted(quantity, k * STEP) for k, factor in STENCIL], axis=0) / STEP
            for quantity in ("position", "velocity", "acceleration")
        ]
    )


def _rigid_body(
    geometry: Geometry, record: Record, at: list[int], weight: np.ndarray
) -> MotionSamples:
    """Derivatives of sum_jk weight_njk phi_njk of (8) for the base set, weight (n, 3, 8).

    The planar joints stand `at` these columns of the record.

    In the coordinates phi, psi, s of `crane_model.dynamics`; A and B are what the moments of the
    outer boom along (4) and normal (5) to the telescope give in the rows of phi and psi without
    gravity, and they are each other's derivatives with respect to delta.
    """
    a, g = geometry.inner_boom_length, geometry.gravity
    offset = geometry.telescope_offset  # N_TL = a3 m_TL
    motion = record.position, record.velocity, record.acceleration
    q, v, acceleration = (values.T[at] for values in motion)
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
    return MotionSamples(*map(_by_joint, (by_position, by_velocity, by_acceleration)))


def _by_joint(slopes: tuple[np.ndarray, np.ndarray, np.ndarray]) -> np.ndarray:
    """(n, 3) with respect to q2, q3, q4 from phi, psi, s: phi turns with q2, psi with both."""
    by_phi, by_psi, by_s = slopes
    return np.stack([by_phi + by_psi, by_psi, by_s], axis=1)
