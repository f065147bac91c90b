"""Recursive least squares (30) in square-root information form, with forgetting.

Every joint keeps an upper triangle A = [R z; 0 r] with AᵀA = Σ λ^age [φ τ]ᵀ[φ τ] over its rows; a
row is folded in by Givens rotations. No covariance is propagated, so that none can lose its
symmetry or its sign, however long it runs; R is as exact after hours as after seconds.

The joints are combined only when the estimate is read: weights that depend on the residuals of the
whole recording, as in the batch solution, then need no second pass over the data.
"""

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from crane_identification.estimation.regression import (
    BasicSolution,
    balance,
    noise_of_residual,
    solve,
)

# How many correlated residuals are worth one independent one, followed as they come.

FADING = 3
"""A residual weighs as this power of its number, so that those of the first, poor estimates are
forgotten, and an estimate from n rows rests on some n/2 residuals."""


class ResidualCorrelation:
    """The autocovariances of the residual of each joint up to `lags` rows, and what they add up to.

    The factor is the residual's spectral density at frequency 0 over that of white noise of the
    same variance: the mean of slowly varying correlated residuals has that many times the variance.
    It is the sum of autocorrelations, those beyond half the lags fading out (the flat-top window of
    Politis and Romano 1995), and never below `least`, what the overlap of rows makes of white
    noise. No autoregression: rows that are averages have next to nothing at their highest
    frequencies, and there a fitted polynomial is nearly singular.

    It holds where the regressor varies slowly compared with the memory of the residual, as it does
    for sensor noise; it does not cover model errors that last as long as the motion itself (a
    missing effect looks like a bias, not like noise).
    """

    def __init__(self, joints: int, lags: int, least: float = 1.0):
        self._least = least
        self._weights = np.clip(2.0 - 2.0 * np.arange(lags + 1) / (lags + 1), 0.0, 1.0)
        self._products = np.zeros((joints, lags + 1))
        self._counts = np.zeros((joints, lags + 1))
        self._past = np.full((joints, lags), np.nan)

    def add(self, residual: np.ndarray, used: np.ndarray) -> None:
        """The residuals (j,) of the next row of the grid; those not `used` (j,) are gaps."""
        values = np.where(used, residual, np.nan)
        _accumulate(values, self._past, self._products, self._counts)

    def interrupt(self) -> None:
        self._past[:] = np.nan

    def factors(self) -> np.ndarray:
        """(j,) rows that are worth one independent row, at least `least`."""
        means = self._products / np.maximum(self._counts, 1.0)
        power = np.where(means[:, 0] > 0.0, means[:, 0], 1.0)
        return np.maximum(2.0 * means @ self._weights / power - 1.0, self._least)


@njit(cache=True)
def _accumulate(
    values: np.ndarray, past: np.ndarray, products: np.ndarray, counts: np.ndarray
) -> None:
    joints, lags = past.shape
    for j in range(joints):
        if not np.isnan(values[j]):
            for lag in range(lags + 1):
                before = values[j] if lag == 0 else past[j, lag - 1]
                if np.isnan(before):
                    break  # only with everything between them
                # the weights 1, ..., n to the power FADING, but for a common factor
                count = max(counts[j, lag], FADING / (FADING + 1.0))
                keep = 1.0 - FADING / ((FADING + 1.0) * count)
                products[j, lag] = keep * products[j, lag] + values[j] * before
                counts[j, lag] = keep * counts[j, lag] + 1.0
        for lag in range(lags - 1, 0, -1):
            past[j, lag] = past[j, lag - 1]
        past[j, 0] = values[j]


class Solution(NamedTuple):
    """Θ of p parameters and how certain it is; inf where the rows so far determine nothing.

    `values` (p,) are NaN and `std_devs` (p,) infinite where not `determined` (p,). Per joint (j,):
    `weights` [1/N m or 1/N], and `residual_rms` [N m or N]. `condition_number` is that of the
    weighted columns scaled to norm 1 (inf if rank deficient).
    """

    values: np.ndarray
    std_devs: np.ndarray
    covariance: np.ndarray
    determined: np.ndarray
    weights: np.ndarray
    residual_rms: np.ndarray
    condition_number: float


class Recursion:
    """Rows of (28) folded in as they come; `forgetting` is the factor λ per used row of a joint.

    Excitation gating: a row that is not used changes nothing at all, so that a joint forgets only
    in exchange for what it learns, and its information does not fade while it stands still.
    """

    def __init__(self, joints: int, parameters: int, forgetting: float = 1.0):
        if not 0.0 < forgetting <= 1.0:
            raise ValueError(f"forgetting must be above 0 and at most 1, got {forgetting}")
        self._root = np.sqrt(forgetting)
        self._factor = np.zeros((joints, parameters + 1, parameters + 1))
        self._information = np.zeros((joints, parameters, parameters))
        self._count = np.zeros(joints)  # Σ λ^age
        self.rows = np.zeros(joints, dtype=np.int64)

    def update(self, matrix: np.ndarray, force: np.ndarray, used: np.ndarray) -> None:
        """Fold in one row of each joint: `matrix` (j, p), `force` (j,), where `used` (j,)."""
        _fold(
            matrix, force, used, self._root, self._factor, self._information, self._count, self.rows
        )

    @property
    def samples(self) -> int:
        return int(self.rows.sum())

    @property
    def well_posed(self) -> bool:
        """Return whether there are more rows than parameters."""
        return self.samples > self._factor.shape[1] - 1

    def solve(self, correlation: np.ndarray | None = None) -> Solution:
        """The estimate on all rows so far, as the batch solution weights them.

        Several joints are weighted by the inverse of the standard deviation of their noise, in
        passes from equal weights until they stay the same. `correlation` (j,): number of rows that
        are worth one independent row (None: 1, white residuals). With b = (Σ R'W²R)⁻¹ the
        covariance is b (Σ_j c_j s_j² W_j² Φ_j'Φ_j) b, where forgetting enters Φ_j'Φ_j as λ^(2 age):
        a row that is half forgotten still carries its whole noise.
        """
        joints, parameters = len(self._factor), self._factor.shape[1] - 1
        if not self.well_posed:
            return _unknown(joints, parameters)
        force = self._rms(np.zeros(parameters))
        weights = balance(joints, self._noise, force)
        values, determined, bread, condition = self._combined(weights)
        rms = self._rms(values)
        power = (weights * rms) ** 2
        noise = power if correlation is None else power * correlation
        meat = np.einsum("j,jkl->kl", noise * weights**2, self._information)
        spread = bread @ meat @ bread * self._lost(bread, meat, power)
        return Solution(
            values=np.where(determined, values, np.nan),
            std_devs=np.where(determined, np.sqrt(np.diag(spread)), np.inf),
            covariance=np.where(determined[:, None] & determined, spread, np.nan),
            determined=determined,
            weights=weights,
            residual_rms=np.where(self._count > 0.0, rms, np.nan),
            condition_number=condition,
        )

    def values(self, weights: np.ndarray) -> np.ndarray:
        """Θ (p,) alone, for given weights (j,), in a tenth of the time; NaN while R is singular."""
        return _solve_triangles(self._factor, weights)

    def _combined(self, weights: np.ndarray) -> BasicSolution:
        """The solution of all joints together, each weighted; its `bread` is (Σ R'W²R)⁻¹."""
        stacked = (self._factor[:, :-1] * weights[:, None, None]).reshape(-1, self._factor.shape[2])
        return solve(stacked[:, :-1], stacked[:, -1])

    def _rms(self, values: np.ndarray) -> np.ndarray:
        """Root mean square residual (j,) of the rows so far, from the triangles alone."""
        seen = np.append(-values, 1.0)
        return np.linalg.norm(self._factor @ seen, axis=1) / np.sqrt(np.maximum(self._count, 1e-9))

    def _noise(self, weights: np.ndarray) -> np.ndarray:
        """Standard deviation (j,) of the noise, by the solution with these weights."""
        found = self._combined(weights)
        norm = self._rms(found.values) * np.sqrt(self._count)
        return noise_of_residual(norm, self._count, weights, found.bread, self._information)

    def _lost(self, bread: np.ndarray, meat: np.ndarray, power: np.ndarray) -> float:
        """Power by which residuals are below the noise because parameters were fitted to them."""
        total = float(power @ self._count)
        explained = float(np.trace(bread @ meat))
        parameters = int(np.count_nonzero(np.diag(bread)))
        most = 1.0 - 1.0 / max(self._count.sum() - parameters, 2.0)
        return 1.0 / (1.0 - min(explained / total, most)) if total > 0.0 else 1.0


def _unknown(joints: int, parameters: int) -> Solution:
    nothing = np.full((parameters, parameters), np.nan)
    return Solution(
        values=nothing[0],
        std_devs=np.full(parameters, np.inf),
        covariance=nothing,
        determined=np.zeros(parameters, dtype=bool),
        weights=np.ones(joints),
        residual_rms=np.full(joints, np.nan),
        condition_number=np.inf,
    )


@njit(cache=True)
def _rotate(factor: np.ndarray, row: np.ndarray) -> None:
    """Fold `row` (m,) into the upper triangle `factor` (m, m) by Givens rotations; spoils it."""
    size = len(row)
    for k in range(size):
        if row[k] == 0.0:
            continue
        upper = factor[k]
        length = math.hypot(upper[k], row[k])
        cos, sin = upper[k] / length, row[k] / length
        for i in range(k, size):
            above, below = upper[i], row[i]
            upper[i] = cos * above + sin * below
            row[i] = cos * below - sin * above


@njit(cache=True)
def _fold(
    matrix: np.ndarray,
    force: np.ndarray,
    used: np.ndarray,
    root: float,
    factor: np.ndarray,
    information: np.ndarray,
    count: np.ndarray,
    rows: np.ndarray,
) -> None:
    parameters = matrix.shape[1]
    row = np.empty(parameters + 1)
    for j in range(len(force)):
        if not used[j]:
            continue
        row[:parameters] = matrix[j]
        row[parameters] = force[j]
        if root != 1.0:
            factor[j] *= root
            information[j] *= root**4
            count[j] *= root**2
        count[j] += 1.0
        rows[j] += 1
        for k in range(parameters):
            if row[k] != 0.0:
                line = information[j, k]
                for i in range(parameters):
                    line[i] += row[k] * row[i]
        _rotate(factor[j], row)


@njit(cache=True)
def _solve_triangles(factor: np.ndarray, weights: np.ndarray) -> np.ndarray:
    joints, size, _ = factor.shape
    whole = factor[0] * weights[0]
    for j in range(1, joints):
        for k in range(size):
            _rotate(whole, factor[j, k] * weights[j])
    values = np.empty(size - 1)
    for k in range(size - 2, -1, -1):
        rest = whole[k, size - 1]
        for i in range(k + 1, size - 1):
            rest -= whole[k, i] * values[i]
        values[k] = rest / whole[k, k] if whole[k, k] != 0.0 else np.nan
    return values
