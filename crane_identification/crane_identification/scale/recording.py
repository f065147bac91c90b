"""What a fit by sums of information matrices makes of one recording, where that can be read."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from crane_identification.data.bad_samples import usable
from crane_identification.data.column_map import ColumnMap
from crane_identification.data.log import Log
from crane_identification.data.recording_log import read_recording
from crane_identification.data.resample import slowed
from crane_identification.estimation.covariance import correlated, white
from crane_identification.estimation.lack_of_fit import lack_of_fit
from crane_identification.estimation.regression import build_rows
from crane_identification.estimation.rows import Rows
from crane_identification.options import Covariance, Options
from crane_identification.preparation.run import Preparation
from crane_model.model_file import Model


def read(path: Path, model: Model, columns: ColumnMap | None, options: Options) -> Log:
    """The part of it that `options` name, without samples that are known to be bad."""
    log = read_recording(path, model.joints, columns, namespace=options.namespace)
    return slowed(usable(log, options.begin, options.end), options.rate)


def rows_of(preparations: Sequence[Preparation], model: Model, factor: int) -> Rows:
    """All of its gapless runs."""
    return Rows.stack([build_rows(model, one, factor) for one in preparations])


def meat(rows: Rows, weights: np.ndarray, values: np.ndarray, assumption: Covariance) -> np.ndarray:
    """Σ ΦᵀW Γ WΦ (p, p) of one recording."""
    unit = np.eye(len(values))
    spread = np.broadcast_to(weights, rows.force.shape)
    residual = spread * rows.residual(values)
    if assumption is Covariance.CORRELATED:
        return correlated(rows, spread, residual, unit, lack_of_fit(rows, values))
    columns = rows.stacked * spread[rows.used][:, None]
    return columns.T @ columns * white(residual[rows.used], unit, assumption)[0, 0]
