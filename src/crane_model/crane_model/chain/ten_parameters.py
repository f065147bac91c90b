"""The regressor of inverse dynamics (8) of a serial chain, ten parameters a body.

tau = Y(q, q', q'') p with p = (m, m c_x, m c_y, m c_z, I_xx, I_xy, I_yy, I_xz, I_yz, I_zz) of each
body in its own frame, inertias about that frame's origin: order and meaning of
`pinocchio.Inertia.toDynamicParameters`. Atkeson, An and Hollerbach (1986).
"""

import numpy as np
from numpy.typing import NDArray

from crane_model.array import Array
from crane_model.chain.lanes import fill
from crane_model.chain.serial_chain import SerialChain

PER_BODY = ("m", "mx", "my", "mz", "Ixx", "Ixy", "Iyy", "Ixz", "Iyz", "Izz")


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
