"""Base parameters: which combinations the motion determines, and the way from and to (9)."""

import math
from typing import NamedTuple

import numpy as np
from scipy.linalg import qr

from crane_model.array import Array
from crane_model.dynamics import Geometry
from crane_model.machine import Machine

STANDARD_PARAMETERS = tuple(
    f"{quantity}_{body}" for body in ("FL", "SL", "TG") for quantity in ("m", "mx", "my", "J")
)
"""Mass, mass moments along and normal to the link, and inertia about its own origin, of the inner
boom (origin joint 2), the outer boom (elbow) and telescope with gripper (elbow, at q4 = 0)."""

REPORT_PARAMETERS = (
    "m_FL rcm_FL^2 + Izz_FL",
    "rcm_SL m_SL",
    "m_SL",
    "m_Gr r7 + rcm_TL m_TL",
    "m_TL + m_Gr",
    "m_TL rcm_TL^2 + Izz_SL + Izz_TL + m_SL rcm_SL^2 + Izz_Gr",
    "m_FL rcm_FL, along",
    "m_FL rcm_FL, normal",
)
"""The entries of (9), with m_TL for the misprinted m_FL in the sixth and the two moments of the
inner boom that seventh and eighth, printed alike, must be. Distances are from the elbow at
q4 = 0."""

REPORT_UNITS = ("kg m2", "kg m", "kg", "kg m", "kg", "kg m2", "kg m", "kg m")

_ROUNDING = 1e-14  # relative size of what exact arithmetic would have made zero


class Basis(NamedTuple):
    """The outcome of a rank-revealing QR of stacked regressor columns."""

    rank: int
    independent: tuple[int, ...]  # columns that carry the base parameters
    dependent: tuple[int, ...]
    combination: Array  # (rank, dependent): column_dependent = column_independent @ this
    margin: float  # smallest kept over largest dropped diagonal of R


def reveal_rank(columns: Array, tolerance: float = 1e-9) -> Basis:
    """Rank of (N, p) stacked columns by column-pivoted QR of the normalised columns.

    A column whose diagonal entry of R is below `tolerance` times the largest depends on the
    others: its parameter is only seen in combination with theirs. Columns that hold nothing but
    rounding errors of the largest count as zero.
    """
    norms = np.linalg.norm(columns, axis=0)
    seen = norms > _ROUNDING * norms.max()
    scale = np.where(seen, norms, 1.0)
    _, r, pivots = qr(columns * (seen / scale), mode="economic", pivoting=True)
    diagonal = np.abs(np.diag(r))
    rank = int((diagonal > tolerance * diagonal[0]).sum()) if diagonal[0] > 0.0 else 0
    kept, dropped = pivots[:rank], pivots[rank:]
    combination = np.linalg.solve(r[:rank, :rank], r[:rank, rank:])
    combination = combination / scale[kept][:, None] * scale[dropped]
    margin = np.inf if rank == len(diagonal) else diagonal[rank - 1] / max(diagonal[rank], 1e-300)
    return Basis(rank, tuple(map(int, kept)), tuple(map(int, dropped)), combination, float(margin))


def lagrangian_from_standard(geometry: Geometry) -> Array:
    """(9, 12): the nine parameters of `crane_model.dynamics` from the standard ones."""
    a = geometry.inner_boom_length
    _, mx_fl, my_fl, j_fl, m_sl, mx_sl, my_sl, j_sl, m_tg, mx_tg, my_tg, j_tg = np.eye(12)
    return np.stack(
        [
            j_fl + a**2 * (m_sl + m_tg),
            mx_fl + a * (m_sl + m_tg),
            my_fl,
            j_sl + j_tg,
            mx_sl + mx_tg,
            my_sl + my_tg,
            m_tg,
            mx_tg,
            my_tg,
        ]
    )


def standard_from_chain(machine: Machine) -> Array:
    """(12, 10 m): the standard parameters from ten of each body of the machine's chain.

    The joints' frames are turned by theta20 against the line to the elbow (inner boom) and against
    the telescope's axis (outer boom, the other way), with z out of the plane; the telescope's has
    x along the normal, z along the axis and lies a3 off the elbow.
    """
    crane, bodies = machine.as_planar(), len(machine.joints)
    m, mx, my, mz, i_yy, i_zz = 0, 1, 2, 3, 6, 9
    cos, sin, a3 = math.cos(crane.theta_2_0), math.sin(crane.theta_2_0), crane.telescope_offset
    standard = np.zeros((12, bodies, 10))
    first, second, third = standard[:4, -3], standard[4:8, -2], standard[8:, -1]
    first[0, m] = first[3, i_zz] = 1.0
    first[1, [mx, my]] = cos, sin
    first[2, [mx, my]] = -sin, cos
    second[0, m] = second[3, i_zz] = 1.0
    second[1, [mx, my]] = cos, -sin
    second[2, [mx, my]] = sin, cos
    third[0, m] = 1.0
    third[1, mz] = 1.0
    third[2, [mx, m]] = 1.0, a3
    third[3, [i_yy, mx, m]] = 1.0, 2.0 * a3, a3**2
    return standard.reshape(12, -1)


def report_from_base(geometry: Geometry) -> Array:
    """(8, 8): the entries of (9) from the base set, given that m_SL is on the telescope's axis.

    Only that assumption of the report separates m_SL: the normal moment S_SL_normal is then
    a3 (m_SL + m_TL). Covariances follow as P_report = T P_base T^T.
    """
    a, offset = geometry.inner_boom_length, geometry.telescope_offset
    j_fl, s_fl, n_fl, j_sl, s_sl, n_sl, m_tl, s_tl = np.eye(8)
    m_sl = n_sl / offset - m_tl
    carried = m_sl + m_tl
    return np.stack(
        [
            j_fl - a**2 * carried,
            s_sl - s_tl,
            m_sl,
            s_tl,
            m_tl,
            j_sl,
            s_fl - a * carried,
            n_fl,
        ]
    )
