"""Least squares by sums of information matrices, recording by recording."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial, reduce
from operator import add
from pathlib import Path
from typing import Any, NamedTuple, Self

import numpy as np
from numpy.linalg import LinAlgError
from scipy.linalg import cholesky

from crane_identification.data.bad_samples import usable
from crane_identification.data.column_map import ColumnMap
from crane_identification.data.log import Log
from crane_identification.data.recording_log import read_recording
from crane_identification.data.resample import slowed
from crane_identification.estimation.excitation import at_one_speed, undetermined_in_words
from crane_identification.estimation.least_squares import meat
from crane_identification.estimation.regression import (
    BasicSolution,
    Rows,
    balance,
    build_rows,
    common_factor,
    noise_of_residual,
    solve,
)
from crane_identification.options import Options
from crane_identification.preparation.prepare import prepare
from crane_identification.preparation.run import Preparation
from crane_identification.recording_check.check import vetted
from crane_model.errors import DataError
from crane_model.model_file import Model
from crane_model.progress_bar import Progress, silent

DEPENDENT_COLUMN_SHARE = 1e-6  # of a column, within which the others may make it up
RESOLVED = 1e-14  # of a column's square, what rounding may have taken from it


@dataclass(frozen=True)
class Information:
    """Information matrices: all that least squares needs to know of any number of samples.

    `matrix` (j, p + 1, p + 1): [Φ τ]ᵀ[Φ τ] of each joint, from `rows` (j,). They add up over
    recordings and machines, and give the residual of any Θ, from which joints are balanced.
    """

    joints: tuple[str, ...]
    names: tuple[str, ...]
    units: tuple[str, ...]
    matrix: np.ndarray
    rows: np.ndarray

    @classmethod
    def of(cls, rows: Rows) -> Self:
        values = np.concatenate([rows.matrix, rows.force[:, :, np.newaxis]], axis=2)
        values[~rows.used] = 0.0
        matrix = np.stack([values[:, j].T @ values[:, j] for j in range(len(rows.joints))])
        return cls(rows.joints, rows.names, rows.units, matrix, rows.used.sum(axis=0))

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
        """Weights (j,) with which the weighted noise of each joint has standard deviation 1."""

        def noise(weights: np.ndarray) -> np.ndarray:
            found = self.solve(weights)
            norm = self.rms(found.values) * np.sqrt(self.rows)
            products = self.matrix[:, :-1, :-1]
            return noise_of_residual(norm, self.rows, weights, found.bread, products)

        return balance(len(self.joints), noise, self.rms(np.zeros(len(self.names))))

    def solve(self, weights: np.ndarray) -> BasicSolution:
        """Θ (30) with weights (j,) [1/N m, 1/N].

        The triangle R with RᵀR = [Φ τ]ᵀW²[Φ τ] takes the place of the rows. Squaring has cost half
        of the digits: columns that depend on each other within 1e-6 count as dependent.
        """
        total = np.einsum("j,jkl->kl", weights**2, self.matrix)
        scale = np.sqrt(np.maximum(np.diag(total), np.finfo(float).tiny))
        triangle = _root(total / np.outer(scale, scale)) * scale
        return solve(triangle[:-1, :-1], triangle[:-1, -1], DEPENDENT_COLUMN_SHARE)


def _root(matrix: np.ndarray) -> np.ndarray:
    """Upper triangle R (m, m) with RᵀR = matrix, whose diagonal is 1."""
    try:
        return cholesky(matrix)
    except LinAlgError:  # singular: what is missing is within rounding
        return cholesky(matrix + RESOLVED * len(matrix) * np.eye(len(matrix)))


# The fit that information matrices of recordings add up to, in two rounds over the recordings.
#
# The first sums the information, which gives the same Θ as all rows in one place; the second the
# covariance: there the noise of each recording is judged by itself, so that the standard deviations
# are close to, and not the same as, those of all rows in one place.


@dataclass(frozen=True)
class SummedFit:
    """The `model` from the `information` of all recordings, and the `suspicions` about them."""

    model: Model
    information: Information
    suspicions: tuple[str, ...]


@dataclass(frozen=True)
class FirstRound:
    """First round: `information`, `recordings`, `weights` (j,) of joints, and `solution`."""

    information: Information
    recordings: int
    weights: np.ndarray
    solution: BasicSolution

    @classmethod
    def of(cls, model: Model, parts: list[Information]) -> Self:
        """Raises `DataError` if the recordings do not determine the model."""
        information = reduce(add, parts)
        if information.rows.sum() <= len(information.names):
            raise DataError(
                f"least squares: {information.rows.sum()} rows for {len(information.names)} "
                "parameters; record longer"
            )
        weights = information.balancing()
        solution = information.solve(weights)
        names, count = np.array(information.names), len(information.names)
        pairs = at_one_speed(model, information.matrix[:, :count, :count]).values()
        unknown = names[~solution.determined | np.isin(names, [n for pair in pairs for n in pair])]
        if len(unknown):
            raise DataError(undetermined_in_words(model, unknown.tolist()))
        return cls(information, len(parts), weights, solution)

    def fitted(self, model: Model, meat: np.ndarray) -> Model:
        """With Θ, and standard deviations of the `meat` (p, p) that the second round sums."""
        covariance = self.solution.bread @ meat @ self.solution.bread
        return model.with_estimate(
            self.solution.values,
            np.sqrt(np.diag(covariance)),
            f"least squares (31) from the information of {self.recordings} recordings, "
            f"{self.information.rows.sum()} rows",
        )


# Least squares recording by recording: memory does not grow with their number.
#
# One is read, prepared and turned into rows at a time; what is kept of it is its information
# matrix. Every recording is read twice.

Each = Callable[[str, Callable[[Path], Any], Sequence[Path]], Sequence[Any]]
"""Results of a function on each recording, in their order; the first argument names the phase."""


class _Told(NamedTuple):
    """Data kept of a recording: decimated by `factor`."""

    information: Information
    factor: int
    suspicions: tuple[str, ...]


@dataclass(frozen=True)
class _Reading:
    """How recordings are read."""

    model: Model
    columns: ColumnMap | None
    options: Options
    trusted: bool

    def told(self, factor: int | None, path: Path) -> _Told:
        log, preparations = self._prepared(path)
        suspicions = vetted(self.model.machine, [log], self.trusted, self.model)
        factor = common_factor(preparations, factor)
        return _Told(Information.of(self._rows(preparations, factor)), factor, suspicions)

    def meat(self, factor: int, first: FirstRound, path: Path) -> np.ndarray:
        rows = self._rows(self._prepared(path)[1], factor)
        return meat(rows, first.weights, first.solution.values, self.options.covariance)

    def _prepared(self, path: Path) -> tuple[Log, list[Preparation]]:
        """The part of the recording that the options name, without bad samples, and its runs."""
        options, joints = self.options, self.model.joints
        log = read_recording(path, joints, self.columns, namespace=options.namespace)
        log = slowed(usable(log, options.begin, options.end), options.rate)
        return log, prepare(self.model, log, options)

    def _rows(self, preparations: Sequence[Preparation], factor: int) -> Rows:
        return Rows.stack([build_rows(self.model, one, factor) for one in preparations])


def fit_streamed(
    model: Model,
    recordings: Sequence[Path],
    options: Options | None = None,
    progress: Progress = silent,
    columns: ColumnMap | None = None,
    trusted: bool = False,
) -> SummedFit:
    """Θ of `model` by least squares (31) from recordings, by `columns` or as bags of the suite.

    Raises `DataError` as `fitting.fit` does, and where a recording that is not `trusted` looks
    wrong.
    """

    def each(phase: str, of: Callable[[Path], Any], paths: Sequence[Path]) -> list[Any]:
        found = []
        for path in paths:
            found.append(of(path))
            progress(phase, len(found) / len(paths))
        return found

    return fit_by_sums(model, recordings, each, options, columns, trusted)


def fit_by_sums(
    model: Model,
    recordings: Sequence[Path],
    each: Each,
    options: Options | None = None,
    columns: ColumnMap | None = None,
    trusted: bool = False,
) -> SummedFit:
    """As `fit_streamed`, where `each` may spread the recordings over processes."""
    options = options or Options()
    reading = _Reading(model, columns, options, trusted)
    found = each("information", partial(reading.told, options.decimation), recordings)
    factor = min(recording.factor for recording in found)
    coarse = [path for path, one in zip(recordings, found, strict=True) if one.factor != factor]
    again = iter(each("information", partial(reading.told, factor), coarse))
    found = [one if one.factor == factor else next(again) for one in found]
    total = FirstRound.of(model, [recording.information for recording in found])
    parts = each("uncertainty", partial(reading.meat, factor, total), recordings)
    spread = sum(parts, np.zeros_like(total.solution.bread))
    suspicions = tuple(told for recording in found for told in recording.suspicions)
    return SummedFit(total.fitted(model, spread), total.information, suspicions)
