"""The regressor of inverse dynamics (8) of a serial chain, ten parameters a body.

tau = Y(q, q', q'') p with p = (m, m c_x, m c_y, m c_z, I_xx, I_xy, I_yy, I_xz, I_yz, I_zz) of each
body in its own frame, inertias about that frame's origin: order and meaning of
`pinocchio.Inertia.toDynamicParameters`. Atkeson, An and Hollerbach (1986).
"""

from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from crane_model.array import Array
from crane_model.chain.motion import set_motion, workspace
from crane_model.chain.serial_chain import SerialChain
from crane_model.chain.vectors import ZERO, add, cross, dot, row, scaled, turned_back

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
    _fill(chain, rows, *_by_body(len(chain.ratio), parameters), q, v, a, out)


def _by_body(
    bodies: int, parameters: NDArray[np.int64]
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Which of its ten each parameter is, and where (bodies + 1,) those of each body begin."""
    begins = np.searchsorted(parameters, 10 * np.arange(bodies + 1))
    return parameters % 10, begins


@njit(cache=True)
def _fill(
    chain: SerialChain,
    rows: NDArray[np.int64],
    which: NDArray[np.int64],
    begins: NDArray[np.int64],
    q: Array,
    v: Array,
    a: Array,
    out: Array,
) -> None:
    m = len(chain.ratio)
    moving = workspace(m)
    along, about = np.empty((m, 3)), np.empty((m, 3))  # unit twists of joints 0..i at body i
    ten = np.empty(10)
    for n in range(len(q)):
        set_motion(chain, q[n], v[n], a[n], moving)
        for i in range(m):
            p = row(moving.origin, i)
            for k in range(i):
                turn = row(about, k)
                shift = add(row(along, k), cross(turn, p))
                along[k] = turned_back(moving.rotation, i, shift)
                about[k] = turned_back(moving.rotation, i, turn)
            unit = scaled(chain.ratio[i], row(chain.axis, i))
            along[i] = unit if chain.slides[i] else ZERO
            about[i] = ZERO if chain.slides[i] else unit
            w, turning, rise = row(moving.spin, i), row(moving.turning, i), row(moving.rise, i)
            for k in range(i + 1):
                if rows[k] >= 0:
                    _set_power(row(along, k), row(about, k), w, turning, rise, ten)
                    for c in range(begins[i], begins[i + 1]):
                        out[n, rows[k], c] += ten[which[c]]


@njit(cache=True)
def _set_power(along: Any, about: Any, w: Any, turning: Any, rise: Any, out: Array) -> None:
    """What the ten parameters of a moving body ask of a joint with this unit twist.

    The force is m a + al x h + w x (w x h), the moment h x a + I al + w x I w (Newton, Euler).
    """
    out[0] = dot(along, rise)
    moments = add(
        add(cross(along, turning), scaled(dot(along, w), w)),
        add(scaled(-dot(w, w), along), cross(rise, about)),
    )
    out[1], out[2], out[3] = moments
    b = cross(about, w)
    out[4] = about[0] * turning[0] + b[0] * w[0]
    out[5] = about[0] * turning[1] + about[1] * turning[0] + b[0] * w[1] + b[1] * w[0]
    out[6] = about[1] * turning[1] + b[1] * w[1]
    out[7] = about[0] * turning[2] + about[2] * turning[0] + b[0] * w[2] + b[2] * w[0]
    out[8] = about[1] * turning[2] + about[2] * turning[1] + b[1] * w[2] + b[2] * w[1]
    out[9] = about[2] * turning[2] + b[2] * w[2]
