"""What a filter believes, mean and covariance, and what happens to it; steps can be kept."""

from copy import copy
from typing import NamedTuple, Self

import numpy as np

from crane_model.array import Array
from crane_observer.position.kalman import carry, correct, relax


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
