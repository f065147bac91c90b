"""What recordings say about a model: its regressor and the force, filtered alike, run by run.

Nothing is averaged over periods: drift and memory stay visible. Each joint is asked in two zones:
while it moves, where friction is settled, and close to its reversals, where effects with memory
show and the velocity estimate is at its worst. Their rows have noise of their own.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from crane_identification.diagnosis.fit.features import Features, features
from crane_identification.diagnosis.fit.runs import Run, Zone, thinned
from crane_identification.preparation.run import Preparation
from crane_model.errors import DataError
from crane_model.model_file import Model
from crane_model.terms import Term, joints_of, nuisances, typical

ROUNDING_SHARE = 1e-8  # of the largest eigenvalue: directions below are rounding
VISIBLE_SHARE = 0.02
"""Share of a column's norm that must be left beside the others for what it stands for to show: for
an effect to be testable, and for a parameter of the model to be determined."""
ROWS_PER_UNKNOWN = 1.5  # of the base; a channel with fewer says nothing about what it lacks
FEWEST_ROWS = 8


class ShownTerm(NamedTuple):
    """The `columns` (n, c, k) of a term on the rows of some evidence, the share of its norm,
    wherever it acts, that is in samples which are `seen`, and the ratio of rms there to which the
    filter of the rows has `damped` it.
    """

    columns: np.ndarray
    seen: float
    damped: float


@dataclass(frozen=True)
class Evidence:
    """n rows of c channels: `base` (n, c, p), `force` (n, c) [N m, N], `used` (n, c).

    Channels are the j joints in the first zone, then in the second. `run` and `bag` (n,) number the
    gapless runs and the recordings that they come from, `time` (n,) [s]. The first columns of
    `base` are the regressor of the model, the rest nuisance close to reversals. Where the values of
    the model are kept, `std_devs` (p,) says how well they are known.
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

    @property
    def keeps(self) -> bool:
        """Whether the values of the model are kept."""
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
        """What a law may depend on."""
        return features(self.runs)

    @property
    def joints(self) -> tuple[str, ...]:
        """Names of the joints, each with a channel in every zone."""
        return self.model.joints

    @property
    def sources(self) -> tuple[str, ...]:
        """Names of the recordings."""
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
        """The first zone alone, whose channels are the joints, beside the model alone."""
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
        """Root mean square of the force over the used rows of each channel (c,)."""
        return self.rms(self.force)

    def rms(self, values: np.ndarray) -> np.ndarray:
        """Root mean square (c,) of values (n, c) over the used rows."""
        power = (np.where(self.used, values, 0.0) ** 2).sum(axis=0)
        return np.sqrt(power / np.maximum(self.used.sum(axis=0), 1))

    def columns(self, term: Term) -> np.ndarray:
        """The columns (n, c, k) of a term, filtered as the force; `DataError` if it needs more."""
        return self.shown(term).columns

    def shown(self, term: Term) -> ShownTerm:
        """These columns, and what of the term they show."""
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
        return np.concatenate([run.filtered(model.regressor(run.record)) for run in self.runs])

    def roughly(self, columns: np.ndarray) -> np.ndarray:
        """Coefficients (p + k,) of the base and further `columns` (n, c, k), by least squares.

        Rows of a channel are weighted by what is left of it; minimum norm where they coincide.
        """
        matrix, weight = np.concatenate([self.base, columns], axis=2), self.force_rms
        for _ in range(2):
            unit = np.where(weight > 0.0, weight, np.inf)
            scale = np.broadcast_to(1.0 / unit, self.used.shape)[self.used]
            scaled, norms = normed(matrix[self.used] * scale[:, np.newaxis])
            force = self.force[self.used] * scale
            values: np.ndarray = np.linalg.lstsq(scaled, force, rcond=1e-9)[0] / norms
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
    """Whether a channel has too few of its rows `used` (n,) for the d unknown directions that are
    `known` (rows, d) of its base: what these leave of it is no measure of its noise.
    """
    return bool(used.sum() < max(ROWS_PER_UNKNOWN * known.shape[1], FEWEST_ROWS))


def over_zones(evidence: Evidence, values: np.ndarray) -> np.ndarray:
    """Root mean square (j,) of values (n, c) over the used rows of both zones of each joint."""
    joints = len(evidence.joints)
    power = (np.where(evidence.used, values, 0.0) ** 2).reshape(len(values), -1, joints)
    rows = evidence.used.reshape(len(values), -1, joints).sum(axis=(0, 1))
    return np.sqrt(power.sum(axis=(0, 1)) / np.maximum(rows, 1))


def relative(evidence: Evidence, values: np.ndarray) -> np.ndarray:
    """The same (j,) over that of the force."""
    return over_zones(evidence, values) / over_zones(evidence, evidence.force)


def residual(evidence: Evidence, model: Model) -> np.ndarray:
    """Measured less predicted force (n, c) on the rows of the evidence."""
    predicted = evidence.regressor(model) @ model.theta
    return np.where(evidence.used, evidence.force - predicted, 0.0)
