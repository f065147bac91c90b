"""Base parameters: which combinations the motion determines, and the way from and to (9)."""

import math
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from crane_model.array import Array
from crane_model.chain.body_regressor import PER_BODY, regressor
from crane_model.dynamics import Geometry
from crane_model.joint import MachineJoint
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

_ROUNDING_SHARE = 1e-14  # relative size of what exact arithmetic would have made zero


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
    from scipy.linalg import qr  # a third of a second to import

    norms = np.linalg.norm(columns, axis=0)
    seen = norms > _ROUNDING_SHARE * norms.max()
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
        [j_fl - a**2 * carried, s_sl - s_tl, m_sl, s_tl, m_tl, j_sl, s_fl - a * carried, n_fl]
    )


# Base parameters of a serial chain: the combinations of ten a body that its motion determines.

RANDOM_STATES = 200  # random states that show which columns depend on each other
NEGLIGIBLE_SHARE = 1e-9  # of a column's norm

_FIRST = ("mx", "my", "Ixy", "Ixz", "Iyz", "Izz", "Ixx", "mz", "Iyy", "m")
"""Which of a body's parameters stand for a combination, if they can: those that Gautier and Khalil
(1990) keep for a body that turns about z; the rest goes to the bodies before. What else a slide
carries shows on the joint that turns it, but its mass stands for all masses that it carries."""
AXIS_COSINE = 0.99  # of a unit vector that lies along a coordinate axis


class BaseSet(NamedTuple):
    """r combinations p_base = `combination` p of the 10 m parameters p, each led by one of them."""

    leading: NDArray[np.int64]  # (r,) in rising order
    combination: Array  # (r, 10 m)
    names: tuple[str, ...]  # (10 m,) of p, as Izz.boom

    def told(self, k: int) -> str:
        parts = [(f, name) for f, name in zip(self.combination[k], self.names, strict=True) if f]
        parts.sort(key=lambda part: part[1] != self.names[self.leading[k]])
        first, *further = (f"{'-' if f < 0 else '+'} {_factor(f)}{name}" for f, name in parts)
        return " ".join([first.removeprefix("+ "), *further])


@lru_cache(maxsize=64)
def base_set(machine: Machine, joints: tuple[str, ...], zero: tuple[str, ...] = ()) -> BaseSet:
    """Base parameters that forces on `joints` show if only these move, and `zero` ones are zero.

    By a rank-revealing QR of the regressor's columns at random states.
    """
    names = tuple(f"{kind}.{joint.name}" for joint in machine.joints for kind in PER_BODY)
    moving = [machine.index(joint) for joint in joints]
    low = np.array([machine.limits[joint].position_min for joint in joints])
    high = np.array([machine.limits[joint].position_max for joint in joints])
    rng = np.random.default_rng(0)
    states = np.zeros((3, RANDOM_STATES, len(machine.joint_names)))
    states[0][:, moving] = rng.uniform(low, high, (RANDOM_STATES, len(joints)))
    states[1:, :, moving] = rng.standard_normal((2, RANDOM_STATES, len(joints)))
    columns = regressor(machine.chain, *states)[:, moving].reshape(-1, len(names))
    left = [i for i, name in enumerate(names) if name not in zero]
    order = sorted(left, key=lambda i: _rank(machine.joints[i // 10], PER_BODY[i % 10]) + (-i,))
    leading = _independent(columns, order)
    dependent = [i for i in left if i not in set(leading)]
    combination = np.zeros((len(leading), len(names)))
    combination[range(len(leading)), leading] = 1.0
    found = np.linalg.lstsq(columns[:, leading], columns[:, dependent], rcond=None)[0]
    combination[:, dependent] = np.where(np.abs(found) > NEGLIGIBLE_SHARE, found, 0.0)
    return BaseSet(np.array(leading), combination, names)


def _rank(joint: MachineJoint, quantity: str) -> tuple[bool, bool, int]:
    """Place of a body's parameter among those that may stand for a combination, lowest first."""
    mass = quantity == "m"
    return mass, mass == (joint.kind == "revolute"), _FIRST.index(_as_about_z(joint, quantity))


def _as_about_z(joint: MachineJoint, quantity: str) -> str:
    """The quantity (m, mx, ..., Izz) in axes that are exchanged so that the joint's axis is z."""
    axis = int(np.argmax(np.abs(joint.direction)))
    if abs(joint.direction[axis]) < AXIS_COSINE:
        return quantity
    letters = {"xyz"[(axis + 1) % 3]: "x", "xyz"[(axis + 2) % 3]: "y", "xyz"[axis]: "z"}
    return quantity[0] + "".join(sorted(letters[letter] for letter in quantity[1:]))


def _independent(columns: Array, order: list[int]) -> list[int]:
    """The columns that do not depend on those before them in `order`, rising."""
    norms = np.linalg.norm(columns, axis=0)
    smallest, basis, kept = NEGLIGIBLE_SHARE * norms.max(), np.empty((0, len(columns))), []
    for i in order:
        if norms[i] <= smallest:
            continue
        rest = columns[:, i] / norms[i]
        for _ in range(2):  # the second time takes away what rounding left
            rest = rest - basis.T @ (basis @ rest)
        if (size := np.linalg.norm(rest)) > NEGLIGIBLE_SHARE:
            basis = np.vstack([basis, rest / size])
            kept.append(i)
    return sorted(kept)


def _factor(factor: float) -> str:
    return "" if abs(abs(factor) - 1.0) < NEGLIGIBLE_SHARE else f"{abs(factor):.6g} "
