"""Least squares recording by recording: memory does not grow with their number.

One is read, prepared and turned into rows at a time; what is kept of it is its information matrix.
Every recording is read twice.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from crane_identification.data.column_map import ColumnMap
from crane_identification.estimation.covariance import meat
from crane_identification.estimation.regression import common_factor
from crane_identification.options import Options
from crane_identification.preparation.prepare import prepare
from crane_identification.preparation.run import Preparation
from crane_identification.recording_check.check import vetted
from crane_identification.scale.information import Information
from crane_identification.scale.recording import read, rows_of
from crane_identification.scale.summed import FirstRound, SummedFit
from crane_model.model_file import Model
from crane_model.progress import Progress, silent


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
