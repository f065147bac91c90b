"""What recordings say about a model: its regressor and the force, filtered alike, run by run.

Nothing is averaged over periods: drift and memory stay visible.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import Enum
from functools import cached_property

import numpy as np

from crane_identification.preparation import Preparation
from crane_identification.regression import OPEN
from crane_identification.signals.decimate import decimate, decimation_rows
from crane_model.errors import DataError
from crane_model.model_file import Model
from crane_model.record import Record
from crane_model.terms import Term, joints_of, nuisances, typical


class Region(Enum):
    """Which samples are asked."""

    MOVING = "while the joints move"
    ALL = "with the reversals"


@dataclass(frozen=True)
class Run:
    """One gapless run: its record, the rows of it that are kept, and the gate before the filter."""

    source: str
    record: Record
    gate: np.ndarray  # (samples, j)
    factor: int

    def filtered(self, columns: np.ndarray) -> np.ndarray:
        """(samples, j, k) to the decimated rows, gated; columns of zeros cost nothing."""
        kept = len(decimation_rows(len(self.record), self.factor))
        out = np.zeros((kept, *columns.shape[1:]))
        there = columns.any(axis=0)
        gated = columns[:, there] * self.gate[:, np.nonzero(there)[0]]
        out[:, there] = decimate(gated, self.factor)
        return out


@dataclass(frozen=True)
class Evidence:
    """n decimated rows of j joints: `base` (n, j, p), `force` (n, j) [N m, N], `used` (n, j).

    `run` and `bag` (n,) number the gapless runs and the recordings that they come from, `time`
    (n,) [s]. The first columns of `base` are the regressor of the model, the rest nuisance.
    """

    model: Model
    runs: tuple[Run, ...]
    time: np.ndarray
    run: np.ndarray
    bag: np.ndarray
    force: np.ndarray
    base: np.ndarray
    used: np.ndarray

    @property
    def joints(self) -> tuple[str, ...]:
        """Names of the columns of `force`."""
        return self.model.joints

    @cached_property
    def force_rms(self) -> np.ndarray:
        """Root mean square of the force over the used rows of each joint (j,)."""
        return self.rms(self.force)

    def rms(self, values: np.ndarray) -> np.ndarray:
        """Root mean square (j,) of values (n, j) over the used rows."""
        power = (np.where(self.used, values, 0.0) ** 2).sum(axis=0)
        return np.sqrt(power / np.maximum(self.used.sum(axis=0), 1))

    def columns(self, term: Term) -> np.ndarray:
        """The columns (n, j, k) of a term, filtered as the force; `DataError` if it needs more."""
        setting = self.model.setting
        out = np.concatenate([run.filtered(term.columns(run.record, setting)) for run in self.runs])
        if not np.isfinite(out).all():
            raise DataError(f"term '{term.type}': what it needs was not logged throughout")
        return out


def gather(
    model: Model,
    preparations: Sequence[Preparation],
    factor: int,
    region: Region = Region.MOVING,
    first_run: int = 0,
) -> Evidence:
    """The rows of all runs, numbered from `first_run`.

    With the reversals, the nuisance terms of the catalogue stand beside the model.
    """
    sources = list(dict.fromkeys(p.source for p in preparations))
    beside = _nuisances(model) if region is Region.ALL else []
    parts, runs = [], []
    for number, preparation in enumerate(preparations):
        known = preparation.moving.astype(float)
        n = len(preparation.record)
        record = replace(preparation.record, run=np.full(n, first_run + number))
        assert record.force is not None  # prepare() refuses such recordings
        gate = np.ones_like(known) if region is Region.ALL else known
        run = Run(preparation.source, record, gate, factor)
        columns = [model.regressor(record)]
        columns += [term.columns(record, model.setting) for term in beside]
        kept = decimation_rows(n, factor)
        parts.append(
            (
                record.time[kept],
                np.full(len(kept), first_run + number),
                np.full(len(kept), sources.index(preparation.source)),
                run.filtered(record.force[..., np.newaxis])[..., 0],
                run.filtered(np.concatenate(columns, axis=2)),
                decimate(run.gate, factor) > OPEN,
            )
        )
        runs.append(run)
    stacked = [np.concatenate(values) for values in zip(*parts, strict=True)]
    return Evidence(model, tuple(runs), *stacked)


def _nuisances(model: Model) -> list[Term]:
    """Every nuisance on every joint, at both ends and in the middle of its range."""
    out = []
    for cls in nuisances(model.setting):
        ((field, shape),) = cls.shapes.items()
        for joint in joints_of(cls, model.setting):
            out += [
                cls.model_validate(
                    {"type": typical(cls, joint).type, "joint": joint, field: float(x)}
                )
                for x in shape.grid[::2]
            ]
    return out
