"""Evidence of recordings about a model: its regressor and the force, filtered run by run.

Nothing is averaged over periods: drift and memory stay visible. Each joint is asked in two zones:
while it moves, where friction is settled, and close to its reversals, where effects with memory
show and the velocity estimate is at its worst. Their rows have noise of their own.
"""

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from enum import Enum
from functools import cached_property
from typing import NamedTuple

import numpy as np

from crane_identification.data.column_map import COUNTS
from crane_identification.diagnosis.constants import CHANNEL_ROWS, OPEN_TURNING, ROWS_PER_UNKNOWN
from crane_identification.estimation.regression import LEAST_OPEN_SHARE
from crane_identification.preparation.run import Preparation
from crane_identification.signals.decimate import decimation_rows
from crane_identification.signals.gated import GatedFilter, thinned
from crane_model.errors import DataError
from crane_model.model_file import Model
from crane_model.record import Record
from crane_model.terms import Term, joints_of, nuisances, typical

# Gapless runs, and how their samples become rows in two zones.


class Zone(Enum):
    """The samples of a joint that are asked."""

    MOVING = "while it moves"
    TURNING = "close to reversals"

    def gate(self, preparation: Preparation) -> np.ndarray:
        """The samples (samples, j) within the zone, as 1.0."""
        if self is Zone.MOVING:
            return preparation.moving.astype(float)
        return (preparation.signed & ~preparation.moving).astype(float)

    @property
    def open(self) -> float:
        """Share of what the filter sees that must be within the zone."""
        return LEAST_OPEN_SHARE if self is Zone.MOVING else OPEN_TURNING


@dataclass(frozen=True)
class Run:
    """One gapless run: its record, which samples its channels see, and how many make a row."""

    source: str
    number: int
    record: Record
    gate: np.ndarray  # (samples, channels)
    factor: int

    @property
    def kept(self) -> np.ndarray:
        return decimation_rows(len(self.record), self.factor)

    @cached_property
    def seen(self) -> np.ndarray:
        """Samples (samples, j) that a channel of the joint sees, as 1.0."""
        joints = self.record.position.shape[1]
        return (self.gate.reshape(len(self.gate), -1, joints) > 0.0).any(axis=1).astype(float)

    @cached_property
    def _filter(self) -> GatedFilter:
        return GatedFilter(self.gate, self.factor)

    def filtered(self, columns: np.ndarray) -> np.ndarray:
        """Columns (samples, j, k) as gated rows (n, channels, k)."""
        return self._filter.rows(columns)


@dataclass(frozen=True)
class Features:
    """Quantities that a law may depend on: `values` (n, f) on the rows, and their names."""

    names: tuple[str, ...]
    values: np.ndarray


_Reader = Callable[[Record, int], np.ndarray]


def _signal(name: str) -> _Reader:
    """Reader of a signal, that of the joint if each has one."""

    def read(record: Record, j: int) -> np.ndarray:
        values = record.needed(name, "a plot against it")
        return values if values.ndim == 1 else values[:, j]

    return read


_force, _chamber_a, _chamber_b = map(_signal, ("force", "pressure_a", "pressure_b"))
QUANTITIES: dict[str, tuple[str, _Reader | None]] = {
    "position": ("{q}", lambda record, j: record.position[:, j]),
    "velocity": ("{q}/s", lambda record, j: record.velocity[:, j]),
    "acceleration": ("{q}/s2", lambda record, j: record.acceleration[:, j]),
    "displacement": ("{q}", None),
    "displacement since the reversal": (
        "{q}",
        lambda record, j: way_since_turned(record.position[:, j], record.velocity[:, j]),
    ),
    "force": ("{f}", _force),
    "force against the motion": (
        "{f}",
        lambda record, j: _force(record, j) * record.direction[:, j],
    ),
    "rate of the force": ("{f}/s", lambda record, j: _rate_of_force(record)[:, j]),
    "lead": ("s", None),
    "pressure sum": ("Pa", lambda record, j: _chamber_a(record, j) + _chamber_b(record, j)),
    "pressure of chamber B": ("Pa", _chamber_b),
    "valve command": ("1", _signal("command")),
    "extension of the telescope": ("m", None),
    "inclination of the telescope": ("rad", None),
    "slew velocity": ("rad/s", _signal("slew_velocity")),
    "temperature": ("°C", _signal("temperature")),
    "time": ("s", lambda record, j: record.time),
    "recording": ("1", None),
}
"""Units, with those of the coordinate {q} and the force {f} of a joint, and how they are read."""


def _rate_of_force(record: Record) -> np.ndarray:
    known = record.force_rate
    return record.rate(record.needed("force", "a plot against it")) if known is None else known


OF_A_JOINT = (
    *("position", "velocity", "acceleration", "displacement since the reversal"),
    *("force", "pressure sum", "valve command"),
)


def quantities(record: Record) -> dict[str, np.ndarray]:
    """Quantities (n,) that a law may depend on, by name, as far as they were recorded."""
    asked = []
    for j, joint in enumerate(record.joints):
        for name in OF_A_JOINT:
            what, *since = name.split(" since ")
            asked.append((" since ".join([f"{what} of {joint}", *since]), name, j))
    asked += [(name, name, 0) for name in ("slew velocity", "temperature", "time")]
    out: dict[str, np.ndarray] = {}
    for title, name, j in asked:
        reader = QUANTITIES[name][1]
        with suppress(DataError):
            if reader is not None:
                out[title] = reader(record, j)
    return out


def counted(unit: str) -> str:
    """The unit of a quantity of sensors that are not calibrated."""
    return unit if unit in ("1", "s", "°C") else COUNTS


def way_since_turned(q: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Displacement (n,) since the velocity last changed its sign."""
    turned = np.concatenate([[True], np.sign(v[1:]) != np.sign(v[:-1])])
    last = np.maximum.accumulate(np.where(turned, np.arange(len(v)), 0))
    return q - q[last]


TINY = np.finfo(float).tiny
ROUNDING_SHARE = 1e-8  # of the largest eigenvalue: directions below are rounding


class ShownTerm(NamedTuple):
    """The `columns` (n, c, k) of a term, their share `seen`, and the filter's ratio `damped`."""

    columns: np.ndarray
    seen: float
    damped: float


@dataclass(frozen=True)
class Evidence:
    """n rows of c channels: `base` (n, c, p), `force` (n, c) [N m, N], `used` (n, c).

    Channels are the j joints in the first zone, then in the second. `run` and `bag` (n,) number
    runs and recordings. The first columns of `base` are the regressor of the model, the rest
    nuisance close to reversals. If values of the model are kept, `std_devs` (p,) are theirs.
    Sensors that are not calibrated give `counts`.
    """

    model: Model
    runs: tuple[Run, ...]
    time: np.ndarray
    run: np.ndarray
    bag: np.ndarray
    force: np.ndarray
    base: np.ndarray
    used: np.ndarray
    std_devs: np.ndarray | None = None
    counts: bool = field(default=False, kw_only=True)

    @property
    def keeps(self) -> bool:
        return self.std_devs is not None

    @property
    def free(self) -> np.ndarray:
        """Columns (n, c, k) whose coefficients are free: of the base, all or the nuisances."""
        return self.base[:, :, len(self.model.parameters) :] if self.keeps else self.base

    @property
    def uncertain(self) -> np.ndarray:
        """Force (n, c, p or 0) of one standard deviation of each value that is kept."""
        p = 0 if self.std_devs is None else len(self.std_devs)
        return self.base[:, :, :p] * (0.0 if self.std_devs is None else self.std_devs)

    @cached_property
    def left(self) -> np.ndarray:
        """Force (n, c) that the columns which are free may explain."""
        if not self.keeps:
            return self.force
        return self.force - self.base[:, :, : len(self.model.theta)] @ self.model.theta

    @cached_property
    def known(self) -> Features:
        every = [quantities(run.record) for run in self.runs]
        rows = [
            np.stack([values[run.kept] for values in columns.values()], axis=1)
            for run, columns in zip(self.runs, every, strict=True)
        ]
        return Features(tuple(every[-1]), np.concatenate(rows))

    @property
    def joints(self) -> tuple[str, ...]:
        return self.model.joints

    @property
    def sources(self) -> tuple[str, ...]:
        return tuple(dict.fromkeys(run.source for run in self.runs))

    @property
    def bags(self) -> list[tuple[int, ...]]:
        """Numbers of the runs of each recording."""
        return [
            tuple(run.number for run in self.runs if run.source == source)
            for source in self.sources
        ]

    @cached_property
    def moving(self) -> "Evidence":
        """The first zone alone, beside the model alone."""
        j, p = len(self.joints), len(self.model.parameters)
        return replace(
            self,
            runs=tuple(replace(run, gate=run.gate[:, :j]) for run in self.runs),
            force=self.force[:, :j],
            base=self.base[:, :j, :p],
            used=self.used[:, :j],
        )

    @cached_property
    def values(self) -> np.ndarray:
        """Values (p,) of the parameters of the model, roughly, by least squares."""
        return self.roughly(self.base[:, :, :0])[: len(self.model.parameters)]

    @cached_property
    def force_rms(self) -> np.ndarray:
        return self.rms(self.force)

    def over_zones(self, values: np.ndarray) -> np.ndarray:
        """Root mean square (j,) of values (n, c) over the used rows of both zones of a joint."""
        shape = len(values), -1, len(self.joints)
        power = (np.where(self.used, values, 0.0) ** 2).reshape(shape)
        rows = self.used.reshape(shape).sum(axis=(0, 1))
        return np.sqrt(power.sum(axis=(0, 1)) / np.maximum(rows, 1))

    def relative(self, values: np.ndarray) -> np.ndarray:
        """Root mean square (j,) over the used rows, relative to that of the force."""
        return self.over_zones(values) / self.over_zones(self.force)

    def acting(self, columns: np.ndarray, values: np.ndarray) -> float:
        """Root mean square of columns (n, c, k) with values (k,) over that of the force."""
        return float(np.nan_to_num(self.relative(columns @ values)).max())

    def residual(self, model: Model) -> np.ndarray:
        """Measured less predicted force (n, c)."""
        predicted = self.regressor(model) @ model.theta
        return np.where(self.used, self.force - predicted, 0.0)

    def unit(self, unit: str) -> str:
        """A unit, or counts if that is what sensors give."""
        return counted(unit) if self.counts else unit

    def rms(self, values: np.ndarray) -> np.ndarray:
        """Root mean square (c,) of values (n, c) over the used rows."""
        power = (np.where(self.used, values, 0.0) ** 2).sum(axis=0)
        return np.sqrt(power / np.maximum(self.used.sum(axis=0), 1))

    def columns(self, term: Term) -> np.ndarray:
        """The columns (n, c, k) of a term, filtered as the force; `DataError` if it needs more."""
        return self.shown(term).columns

    def shown(self, term: Term) -> ShownTerm:
        rows, inside, total, samples = [], 0.0, 0.0, 0
        for run in self.runs:
            columns = term.columns(run.record, self.model.setting)
            rows.append(run.filtered(columns))
            energy = np.einsum("njk,njk->nj", columns, columns)
            total += float(energy.sum())
            inside += float(energy.ravel() @ run.seen.ravel())
            samples += int(run.seen.sum())
        out = np.concatenate(rows)
        if not np.isfinite(total):  # nor where a gate is shut
            raise DataError(f"term '{term.type}': what it needs was not logged throughout")
        left = float(np.einsum("nck,nck->nc", out, out)[self.used].mean()) if self.used.any() else 0
        return ShownTerm(
            out,
            seen=float(np.sqrt(inside / total)) if total > 0.0 else 1.0,
            damped=float(np.sqrt(left * samples / inside)) if left and inside > 0.0 else 1.0,
        )

    def regressor(self, model: Model) -> np.ndarray:
        """The regressor (n, c, p) of a model of this machine, filtered as the force."""
        if model.setting is not self.model.setting:
            return self._regressor(model)
        if model.terms not in self._regressors:
            self._regressors[model.terms] = self._regressor(model)
        return self._regressors[model.terms]

    @cached_property
    def _regressors(self) -> dict[tuple[Term, ...], np.ndarray]:
        return {}

    def _regressor(self, model: Model) -> np.ndarray:
        return np.concatenate([run.filtered(model.regressor(run.record)) for run in self.runs])

    def roughly(self, columns: np.ndarray) -> np.ndarray:
        """Coefficients (p + k,) of the base and `columns` (n, c, k) by weighted least squares."""
        matrix, weight = np.concatenate([self.base, columns], axis=2), self.force_rms
        for _ in range(2):
            unit = np.where(weight > 0.0, weight, np.inf)
            scale = np.broadcast_to(1.0 / unit, self.used.shape)[self.used]
            force = self.force[self.used] * scale
            values = least_squares(matrix[self.used] * scale[:, np.newaxis], force)
            weight = self.rms(self.force - matrix @ values)
        return values


def gather(
    model: Model, preparations: Sequence[Preparation], factor: int, first_run: int = 0
) -> Evidence:
    """The rows of all runs, numbered from `first_run`, in both zones."""
    sources = list(dict.fromkeys(p.source for p in preparations))
    beside = _nuisances(model)
    joints, known = len(model.joints), len(model.parameters)
    parts, runs = [], []
    for number, preparation in enumerate(preparations):
        n = len(preparation.record)
        record = replace(preparation.record, run=np.full(n, first_run + number))
        assert record.force is not None  # prepare() refuses such recordings
        gate = np.concatenate([zone.gate(preparation) for zone in Zone], axis=1)
        run = Run(preparation.source, first_run + number, record, gate, factor)
        columns = [model.regressor(record)]
        columns += [term.columns(record, model.setting) for term in beside]
        base = run.filtered(np.concatenate(columns, axis=2))
        base[:, :joints, known:] = 0.0  # they stand for what happens close to reversals
        least = np.repeat([zone.open for zone in Zone], joints)
        parts.append(
            (
                record.time[run.kept],
                np.full(len(run.kept), first_run + number),
                np.full(len(run.kept), sources.index(preparation.source)),
                run.filtered(record.force[..., np.newaxis])[..., 0],
                base,
                thinned(gate, factor) > least,
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


def normed(columns: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Columns (n, k) divided by their norms (k,), and these; 1 in place of a norm of 0."""
    norms = np.linalg.norm(columns, axis=0)
    norms = np.where(norms > 0.0, norms, 1.0)
    return columns / norms, norms


def least_squares(columns: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Coefficients (k,) of columns (n, k), whatever their sizes; minimum norm if they coincide."""
    scaled, norms = normed(columns)
    found: np.ndarray = np.linalg.lstsq(scaled, values, rcond=1e-9)[0] / norms
    return found


def leading(columns: np.ndarray, most: int) -> np.ndarray:
    """Orthonormal (n, d <= most): the directions that most of the columns (n, k) share."""
    norms = np.linalg.norm(columns, axis=0)
    scaled = columns[:, norms > 0.0] / norms[norms > 0.0]
    power, vectors = np.linalg.eigh(scaled.T @ scaled)
    order = np.argsort(power)[::-1][:most]
    kept = order[power[order] > ROUNDING_SHARE * power.max(initial=0.0)]
    return scaled @ vectors[:, kept] / np.sqrt(power[kept])


def beside(known: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Values (n, ...) without what the orthonormal columns `known` (n, d) explain."""
    return values - known @ (known.T @ values)


def says_nothing(used: np.ndarray, known: np.ndarray) -> bool:
    """Return whether `used` rows (n,) are too few for directions `known` (rows, d) of the base."""
    return bool(used.sum() < max(ROWS_PER_UNKNOWN * known.shape[1], CHANNEL_ROWS))
