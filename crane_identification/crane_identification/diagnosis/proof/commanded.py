"""The third comparison: motion simulated from valve commands alone, before and after findings."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

from crane_identification.data.log import Log
from crane_identification.diagnosis.fit.fit import Fitted
from crane_identification.validation.command_validation import (
    CommandedRun,
    CommandValidation,
    validate_runs,
)
from crane_model.errors import CraneError
from crane_model.model_file import Model
from crane_model.whole_crane import circuit_of


@dataclass(frozen=True)
class Commanded:
    """Errors on recordings that took no part, a pair of before and after for each horizon.

    Where none can be simulated, `reason` says why.
    """

    pairs: tuple[tuple[CommandValidation, CommandValidation], ...] = ()
    reason: str = ""


def commanded(fit: Fitted, after: Model, logs: Sequence[Log]) -> Commanded:
    """Both models through the hydraulics that the model file holds, along the same windows."""
    before, by_source = fit.before, {log.source: log for log in logs}
    runs = []
    for run in fit.held_out.runs:
        log, time = by_source[run.source], run.record.time
        record = replace(run.record, time=time - fit.session.since(log))  # of its commands
        runs.append(CommandedRun(log, record, float(time[1] - time[0])))
    try:
        circuit_of(before)
        first = validate_runs(before, runs)
        second = first if after is before else validate_runs(after, runs)
    except CraneError as error:
        return Commanded(reason=str(error))
    return Commanded(tuple(zip(first, second, strict=True)))
