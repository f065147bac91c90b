"""Extended Kalman filter in compiled code: sparse prediction, measurements one by one."""

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from crane_model.array import Array


@njit(cache=True, error_model="numpy")
def relax(x: Array, P: Array, decay: Array, added: Array) -> None:
    """x' = decay x, P' = decay P decay + added, in place; decay and added (n,) on the diagonal."""
    n = len(x)
    for i in range(n):
        x[i] *= decay[i]
        for k in range(n):
            P[i, k] *= decay[i] * decay[k]
        P[i, i] += added[i]


@njit(cache=True, error_model="numpy")
def carry(P: Array, rows: NDArray[np.int64], slopes: Array) -> None:
    """P' = F P F^T in place, where F is the identity but for `rows`, whose whole `slopes` (r, n)
    are given; no row of these depends on another of them but itself.
    """
    n = len(P)
    for r in range(len(rows)):
        i = rows[r]
        new = np.zeros(n)
        for k in range(n):
            if slopes[r, k] != 0.0:
                for m in range(n):
                    new[m] += slopes[r, k] * P[k, m]
        own = 0.0
        for k in range(n):
            own += slopes[r, k] * new[k]
        for m in range(n):
            P[i, m] = new[m]
            P[m, i] = new[m]
        P[i, i] = own


@njit(cache=True, error_model="numpy")
def correct(
    x: Array, P: Array, H: Array, innovation: Array, variance: Array, estimated: int
) -> float:
    """Measurements (r,) with slopes H (r, n), whose `innovation` is that before any of them; in
    place, one after the other. Those of infinite variance say nothing. States from `estimated` on
    are considered and not estimated: what is wrong with them counts, and nothing is learnt of it
    (Schmidt, Application of state-space methods to navigation problems, 1966). Returns the log
    likelihood.
    """
    n, likelihood = len(x), 0.0
    begun = x.copy()
    for r in range(len(innovation)):
        if not variance[r] < math.inf:
            continue
        seen = np.zeros(n)
        spread, left = variance[r], innovation[r]
        for i in range(n):
            for k in range(n):
                if H[r, k] != 0.0:
                    seen[i] += P[i, k] * H[r, k]
        for i in range(n):
            spread += H[r, i] * seen[i]
            left -= H[r, i] * (x[i] - begun[i])
        likelihood -= 0.5 * (left * left / spread + math.log(spread / variance[r]))
        for i in range(estimated):
            x[i] += seen[i] * left / spread
        for i in range(n):
            for k in range(n if i < estimated else estimated):
                P[i, k] -= seen[i] * seen[k] / spread
    return likelihood
