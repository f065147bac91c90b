"""Least squares by sums of information matrices, recording by recording."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import reduce
from operator import add
from pathlib import Path
from typing import NamedTuple, Self

import numpy as np

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
    build_rows,
    common_factor,
)
from crane_identification.options import Options
from crane_identification.preparation.prepare import prepare
from crane_identification.preparation.run import Preparation
from crane_identification.recording_check.check import vetted
from crane_identification.scale.information import Information
from crane_model.errors import DataError
from crane_model.model_file import Model
from crane_model.progress_bar import Progress, silent

# What a fit by sums of information matrices makes of one recording, where that can be read.


def read(path: Path, model: Model, columns: ColumnMap | None, options: Options) -> Log:
    """The part of it that `options` name, without samples that are known to be bad."""
    log = read_recording(path, model.joints, columns, namespace=options.namespace)
    return slowed(usable(log, options.begin, options.end), options.rate)


def rows_of(preparations: Sequence[Preparation], model: Model, factor: int) -> Rows:
    """All of its gapless runs."""
    return Rows.stack([build_rows(model, one, factor) for one in preparations])


# The fit that information matrices of recordings add up to, in two rounds over the recordings.
#
# The first sums the information, which gives the same Θ as all rows in one place; the second the
# covariance: there the noise of each recording is judged by itself, so that the standard deviations
# are close to, and not the same as, those of all rows in one place.


@dataclass(frozen=True)
class SummedFit:
    """The `model` with its values, from the `information` of all recordings, and the `suspicions`
    about them.
    """

    model: Model
    information: Information
    suspicions: tuple[str, ...]
    workers: int = 1


@dataclass(frozen=True)
class FirstRound:
    """After the first round: the `information` of so many `recordings`, `weights` (j,) that balance
    the joints, and the `solution`.
    """

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


class _Told(NamedTuple):
    """What is kept of a recording: decimated by `factor`."""

    information: Information
    factor: int
    suspicions: tuple[str, ...]


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
    options = options or Options()

    def prepared(path: Path) -> tuple[list[Preparation], tuple[str, ...]]:
        log = read(path, model, columns, options)
        return prepare(model, log, options), vetted(model.machine, [log], trusted, model)

    def told(path: Path, factor: int | None) -> _Told:
        preparations, suspicions = prepared(path)
        factor = common_factor(preparations, factor)
        return _Told(Information.of(rows_of(preparations, model, factor)), factor, suspicions)

    found = []
    for done, path in enumerate(recordings, start=1):
        found.append(told(path, options.decimation))
        progress("information", done / len(recordings))
    factor = min(one.factor for one in found)
    for i, path in enumerate(recordings):
        if found[i].factor != factor:
            found[i] = told(path, factor)
    total = FirstRound.of(model, [one.information for one in found])
    spread = np.zeros_like(total.solution.bread)
    for done, path in enumerate(recordings, start=1):
        rows = rows_of(prepared(path)[0], model, factor)
        spread += meat(rows, total.weights, total.solution.values, options.covariance)
        progress("uncertainty", done / len(recordings))
    suspicions = tuple(told for one in found for told in one.suspicions)
    return SummedFit(total.fitted(model, spread), total.information, suspicions)
