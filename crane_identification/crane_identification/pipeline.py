"""From logs to a fitted model, and from a fitted model and other logs to its validation."""

from collections.abc import Sequence
from dataclasses import dataclass

from crane_identification.data.log import Log
from crane_identification.estimation.estimate import Estimate
from crane_identification.estimation.least_squares import least_squares
from crane_identification.estimation.rows import Rows
from crane_identification.options import Options
from crane_identification.preparation import Preparation, prepare
from crane_identification.progress import Progress, silent
from crane_identification.regression import build_rows, common_factor
from crane_identification.validation import Validation, compare
from crane_model.errors import DataError
from crane_model.model_file import Model


@dataclass(frozen=True)
class FitResult:
    """The `model` with its values, the `estimate` behind them, and the data of both.

    `rows` are the equations that were solved, `decimation` the factor of the parallel filter.
    """

    model: Model
    estimate: Estimate
    rows: Rows
    preparations: tuple[Preparation, ...]
    decimation: int


def fit(
    model: Model, logs: Sequence[Log], options: Options | None = None, progress: Progress = silent
) -> FitResult:
    """Θ of `model` from recordings, by least squares (31) on all of them together.

    Raises `DataError` if a recording does not fit the model or is too short, and if parameters
    are not determined by these recordings: it names them.
    """
    options = options or Options()
    preparations = _prepare_all(model, logs, options, progress)
    factor = common_factor(preparations, options.decimation)
    rows = Rows.stack([build_rows(model, p, factor) for p in preparations])
    estimate = least_squares(rows, options.covariance)
    progress("fit", 1.0)
    if estimate.undetermined:
        raise DataError(
            f"model '{model.name}': {', '.join(estimate.undetermined)}: these recordings show only "
            f"combinations of these parameters; excite the joints more (both directions, several "
            f"speeds, the whole range) or take terms out of the model"
        )
    sources = ", ".join(dict.fromkeys(p.source for p in preparations))
    provenance = f"{estimate.method}, {estimate.samples} rows of {sources}"
    fitted = model.with_estimate(estimate.values, estimate.std_devs, provenance)
    return FitResult(fitted, estimate, rows, tuple(preparations), factor)


def validate(
    model: Model, logs: Sequence[Log], options: Options | None = None, progress: Progress = silent
) -> tuple[Validation, ...]:
    """Predictions of an estimated `model` on each gapless run of the recordings.

    Raises `DataError` as `fit` does, `ConfigurationError` if the model has no values.
    """
    options = options or Options()
    preparations = _prepare_all(model, logs, options, progress)
    factor = common_factor(preparations, options.decimation)
    return tuple(compare(model, preparation, factor) for preparation in preparations)


def _prepare_all(
    model: Model, logs: Sequence[Log], options: Options, progress: Progress
) -> list[Preparation]:
    if not logs:
        raise DataError(f"model '{model.name}': no recordings given; give at least one")
    preparations = []
    for i, log in enumerate(logs):

        def partly(phase: str, done: float, i: int = i) -> None:
            progress(phase, (i + done) / len(logs))

        preparations += prepare(model, log, options, partly)
    return preparations
