"""The regressor of inverse dynamics (8) of a serial chain, ten parameters a body.

tau = Y(q, q', q'') p with p = (m, m c_x, m c_y, m c_z, I_xx, I_xy, I_yy, I_xz, I_yz, I_zz) of each
body in its own frame, inertias about that frame's origin: order and meaning of
`pinocchio.Inertia.toDynamicParameters`. Atkeson, An and Hollerbach (1986).

A body can have these ten exactly if its pseudo-inertia P (4, 4) is positive definite, with the
second moments Σ = tr(I) 1/2 - I (Wensing, Kim and Slotine 2018):

        | Σ        m c |
    P = |              |
        | (m c)ᵀ   m   |
"""

import numpy as np
from numpy.typing import NDArray

from crane_model.array import Array
from crane_model.chain.lanes import fill
from crane_model.chain.serial_chain import SerialChain

PER_BODY = ("m", "mx", "my", "mz", "Ixx", "Ixy", "Iyy", "Ixz", "Iyz", "Izz")

TEN_FROM_PSEUDO_INERTIA = np.zeros((10, 4, 4))
"""(10, 4, 4): each of the ten is the sum over the products of its matrix with P, entry by entry."""
TEN_FROM_PSEUDO_INERTIA[[0, 1, 2, 3], [3, 0, 1, 2], [3, 3, 3, 3]] = 1.0
TEN_FROM_PSEUDO_INERTIA[[4, 4, 6, 6, 9, 9], [1, 2, 0, 2, 0, 1], [1, 2, 0, 2, 0, 1]] = 1.0
TEN_FROM_PSEUDO_INERTIA[[5, 7, 8], [0, 0, 1], [1, 2, 2]] = -1.0


def pseudo_inertia(ten: Array) -> Array:
    """Pseudo-inertias (..., 4, 4) [kg m2, kg m, kg] of bodies with the ten parameters (..., 10).

    A body with a mass, and with principal moments of inertia of which none exceeds the sum of the
    other two, has a positive definite one.

    >>> ball = np.array([2.0, 0.0, 0.0, 0.0, 0.8, 0.0, 0.8, 0.0, 0.0, 0.8])
    >>> np.linalg.eigvalsh(pseudo_inertia(ball)).round(3)
    array([0.4, 0.4, 0.4, 2. ])
    """
    ten = np.asarray(ten, dtype=float)
    inertia = ten[..., [[4, 5, 7], [5, 6, 8], [7, 8, 9]]]
    out: Array = np.empty((*ten.shape[:-1], 4, 4))
    half = 0.5 * np.trace(inertia, axis1=-2, axis2=-1)[..., np.newaxis, np.newaxis]
    out[..., :3, :3] = half * np.eye(3) - inertia
    out[..., :3, 3] = out[..., 3, :3] = ten[..., 1:4]
    out[..., 3, 3] = ten[..., 0]
    return out


def regressor(chain: SerialChain, q: Array, v: Array, acceleration: Array) -> Array:
    """Y: (n, j) motion to (n, j, 10 m)."""
    out = np.zeros((*q.shape, len(PER_BODY) * len(chain.ratio)))
    fill_regressor(chain, chain.leader, np.arange(out.shape[2]), q, v, acceleration, out)
    return out


def fill_regressor(
    chain: SerialChain,
    rows: NDArray[np.int64],
    parameters: NDArray[np.int64],
    q: Array,
    v: Array,
    acceleration: Array,
    out: Array,
) -> None:
    """Write columns of Y into `out` (n, rows, columns), which comes as zeros: of `parameters`, in
    rising order among the 10 m, side by side. Joint i of the chain is row `rows[i]`; negative, it
    is left out.
    """
    q, v, a = (np.ascontiguousarray(each, dtype=float) for each in (q, v, acceleration))
    fill(chain, rows, parameters, q, v, a, out)
