"""Information matrices: all that least squares needs to know of any number of samples.

Per joint the sums ΦᵀΦ, Φᵀτ and τᵀτ are kept, as one matrix [Φ τ]ᵀ[Φ τ]. They add up over recordings
and over machines; their size does not depend on how many samples they are of. Weights that balance
the joints are found from them too, as each holds the residual of any Θ.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Self

import numpy as np
from numba import njit
from numpy.linalg import LinAlgError
from scipy.linalg import cholesky

from crane_identification.estimation.regression import BasicSolution, Rows, balance, solve
from crane_model.errors import DataError
from crane_model.model_file import Model
from crane_model.record import Record

BLOCK = 2000  # samples whose regressor is filled at a time: it stays in the processor's cache
DEPENDENT = 1e-6  # of a column, within which the others may make it up
RESOLVED = 1e-14  # of a column's square, what rounding may have taken from it


@dataclass(frozen=True)
class Information:
    """`matrix` (j, p + 1, p + 1): [Φ τ]ᵀ[Φ τ] of each joint; `rows` (j,): how many are in it."""

    joints: tuple[str, ...]
    names: tuple[str, ...]
    units: tuple[str, ...]
    matrix: np.ndarray
    rows: np.ndarray

    @classmethod
    def of(cls, rows: Rows) -> Self:
        """That of the used rows."""
        values = np.concatenate([rows.matrix, rows.force[:, :, np.newaxis]], axis=2)
        values[~rows.used] = 0.0
        matrix = np.stack([values[:, j].T @ values[:, j] for j in range(len(rows.joints))])
        return cls(rows.joints, rows.names, rows.units, matrix, rows.used.sum(axis=0))

    @classmethod
    def of_records(cls, model: Model, records: Iterable[Record]) -> Self:
        """That of all samples of `records`, as `model` sees them; memory does not grow with them.

        Raises `DataError` if a record has no force.
        """
        parameters = len(model.parameters)
        joints = len(model.joints)
        matrix = np.zeros((joints, parameters + 1, parameters + 1))
        # The samples of a column lie together.
        block = np.zeros((joints, parameters + 1, BLOCK))
        count = 0
        for record in records:
            if record.force is None:
                raise DataError("information: a record has no measured force; give one that has")
            for start in range(0, len(record), BLOCK):
                part = record.take(slice(start, start + BLOCK))
                filled = block[:, :, : len(part)]
                filled[:] = 0.0
                model.fill(part, filled[:, :-1].transpose(2, 0, 1))
                filled[:, -1] = part.force.T  # type: ignore[union-attr]
                _accumulate(filled, matrix)
            count += len(record)
        names = tuple(parameter.name for parameter in model.parameters)
        units = tuple(parameter.unit for parameter in model.parameters)
        return cls(model.joints, names, units, matrix, np.full(joints, count))

    def __add__(self, other: Self) -> Self:
        if (self.joints, self.names, self.units) != (other.joints, other.names, other.units):
            raise DataError("information of different models or joints cannot be added")
        matrix, rows = self.matrix + other.matrix, self.rows + other.rows
        return type(self)(self.joints, self.names, self.units, matrix, rows)

    def rms(self, values: np.ndarray) -> np.ndarray:
        """Root mean square (j,) of τ - ΦΘ [N m or N]."""
        seen = np.append(-values, 1.0)
        squares = np.einsum("k,jkl,l->j", seen, self.matrix, seen)
        return np.sqrt(np.maximum(squares, 0.0) / np.maximum(self.rows, 1))

    def balancing(self) -> np.ndarray:
        """Weights (j,) with which the weighted residual of each joint has root mean square 1."""
        force = self.rms(np.zeros(len(self.names)))
        return balance(len(self.joints), lambda w: self.rms(self.solve(w).values), force)

    def solve(self, weights: np.ndarray) -> BasicSolution:
        """Θ (30) with weights (j,) [1/N m, 1/N].

        The triangle R with RᵀR = [Φ τ]ᵀW²[Φ τ] takes the place of the rows. Squaring has cost half
        of the digits: columns that depend on each other within 1e-6 count as dependent.
        """
        total = np.einsum("j,jkl->kl", weights**2, self.matrix)
        scale = np.sqrt(np.maximum(np.diag(total), np.finfo(float).tiny))
        triangle = _root(total / np.outer(scale, scale)) * scale
        return solve(triangle[:-1, :-1], triangle[:-1, -1], DEPENDENT)


@njit(cache=True, fastmath={"reassoc", "contract"})  # sums may be vectorised; NaN stays NaN
def _accumulate(columns: np.ndarray, total: np.ndarray) -> None:
    """Add the products of `columns` (j, k, n) to `total` (j, k, k).

    Only of columns that are not zero on their joint: friction of the others is, which is most.
    """
    joints, width, samples = columns.shape
    seen = np.empty(width, dtype=np.int64)
    for j in range(joints):
        count = 0
        for k in range(width):
            if np.any(columns[j, k] != 0.0):
                seen[count] = k
                count += 1
        for first in range(count):
            for second in range(first + 1):
                a, b = seen[first], seen[second]
                product = 0.0
                for i in range(samples):
                    product += columns[j, a, i] * columns[j, b, i]
                total[j, a, b] += product
                if a != b:
                    total[j, b, a] += product


def _root(matrix: np.ndarray) -> np.ndarray:
    """Upper triangle R (m, m) with RᵀR = matrix, whose diagonal is 1."""
    try:
        return cholesky(matrix)
    except LinAlgError:  # singular: what is missing is within rounding
        return cholesky(matrix + RESOLVED * len(matrix) * np.eye(len(matrix)))
