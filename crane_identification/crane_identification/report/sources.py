"""The recordings that went into a report: what each is and how well the model predicts it."""

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from crane_identification.estimation.estimate import condition_numbers
from crane_identification.notation import NONE, percent, plain
from crane_identification.report.content import IdentificationReport
from crane_identification.validation.force_validation import Validation


class SourceRow(NamedTuple):
    """One gapless run of a recording; `errors` of every joint, in percent."""

    source: str
    use: str
    period: str
    periods: str
    condition: str
    errors: list[str]


def source_rows(report: IdentificationReport) -> list[SourceRow]:
    """Training and validation, in the order they were given."""
    uses: dict[str, Sequence[Validation]] = {
        "training": report.compared,
        "validation": report.validations,
    }
    return [row for use, compared in uses.items() for row in _rows(use, compared)]


def _rows(use: str, compared: Sequence[Validation]) -> Iterator[SourceRow]:
    for one in compared:
        averaging, record = one.preparation.averaging, one.preparation.record
        length = float(record.time[-1] - record.time[0]) + one.preparation.step
        yield SourceRow(
            source=one.source,
            use=use,
            period=plain(averaging.period if averaging else length),
            periods=str(averaging.used) if averaging else NONE,
            condition=_condition(one.rows.stacked),
            errors=[percent(float(error)) for error in one.relative_error],
        )


def _condition(stacked: np.ndarray) -> str:
    """In SI units; beyond what the arithmetic can tell, infinite."""
    raw, _ = condition_numbers(stacked)
    return plain(raw if raw < 1e12 else np.inf)
