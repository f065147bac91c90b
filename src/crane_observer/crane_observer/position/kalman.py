"""Extended Kalman filter: belief as mean and covariance, and its steps in compiled code."""

import math
from copy import copy
from typing import NamedTuple, Self

import numpy as np
from numba import njit
from numpy.typing import NDArray

from crane_model.array import Array

# Extended Kalman filter in compiled code: sparse prediction, measurements one by one.


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


# What a filter believes, mean and covariance, and what happens to it; steps can be kept.


class Gaussian:
    """Mean x (size,) and covariance P (size, size). States from `estimated` on are considered and
    not estimated, as `crane_observer.position.kalman.correct` has it.
    """

    def __init__(self, x: Array, P: Array, estimated: int):
        self.x, self.P, self.estimated = x, P, estimated

    def copied(self) -> Self:
        """As it stands, to go back to."""
        other = copy(self)
        other.x, other.P = self.x.copy(), self.P.copy()
        return other

    def relax(self, decay: Array, added: Array) -> None:
        """x' = decay x + noise; `decay` and the variance `added` (size,) on the diagonal."""
        relax(self.x, self.P, decay, added)

    def move(self, way: Array, slopes: Array, noise: Array) -> None:
        """The first states, of a count r, go `way` (r,), whose slopes against all states before
        are such that their new ones have `slopes` (r, size); `noise` (r,) is its variance.
        """
        rows = np.arange(len(way))
        carry(self.P, rows, slopes)
        self.x[rows] += way
        self.P[rows, rows] += noise

    def correct(self, H: Array, innovation: Array, variance: Array) -> float:
        """By measurements (r,), as `crane_observer.position.kalman.correct` has them; the log
        likelihood.
        """
        return correct(self.x, self.P, H, innovation, variance, self.estimated)


class Prediction(NamedTuple):
    """From `before` to `after`: e' = F e + noise of errors e, whose covariance says how much."""

    before: Gaussian
    F: Array  # (size, size)
    after: Gaussian


class Correction(NamedTuple):
    """From `before` to `after`, by measurements (r,)."""

    before: Gaussian
    H: Array  # (r, size)
    variance: Array  # (r,)
    after: Gaussian


class KeptGaussian(Gaussian):
    """One that keeps its steps, the newest last."""

    def __init__(self, begun: Gaussian):
        super().__init__(begun.x.copy(), begun.P.copy(), begun.estimated)
        self.steps: list[Prediction | Correction] = []

    def relax(self, decay: Array, added: Array) -> None:
        """And keep it."""
        before = self.now()
        super().relax(decay, added)
        self.steps.append(Prediction(before, np.diag(decay), self.now()))

    def move(self, way: Array, slopes: Array, noise: Array) -> None:
        """And keep it."""
        before, F = self.now(), np.eye(len(self.x))
        super().move(way, slopes, noise)
        F[: len(way)] = slopes
        self.steps.append(Prediction(before, F, self.now()))

    def correct(self, H: Array, innovation: Array, variance: Array) -> float:
        """And keep it."""
        before = self.now()
        likelihood = super().correct(H, innovation, variance)
        self.steps.append(Correction(before, H, variance, self.now()))
        return likelihood

    def now(self) -> Gaussian:
        """As it stands."""
        return Gaussian(self.x.copy(), self.P.copy(), self.estimated)
