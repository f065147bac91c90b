"""What a fit by sums of information matrices makes of one recording, where that can be read."""

from collections.abc import Sequence
from pathlib import Path

from crane_identification.data.bad_samples import usable
from crane_identification.data.column_map import ColumnMap
from crane_identification.data.log import Log
from crane_identification.data.recording_log import read_recording
from crane_identification.data.resample import slowed
from crane_identification.estimation.regression import build_rows
from crane_identification.estimation.rows import Rows
from crane_identification.options import Options
from crane_identification.preparation.run import Preparation
from crane_model.model_file import Model


def read(path: Path, model: Model, columns: ColumnMap | None, options: Options) -> Log:
    """The part of it that `options` name, without samples that are known to be bad."""
    log = read_recording(path, model.joints, columns, namespace=options.namespace)
    return slowed(usable(log, options.begin, options.end), options.rate)


def rows_of(preparations: Sequence[Preparation], model: Model, factor: int) -> Rows:
    """All of its gapless runs."""
    return Rows.stack([build_rows(model, one, factor) for one in preparations])
