"""The balance of the oil of one joint: rows, columns, their least squares, and the proof."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from scipy.optimize import minimize_scalar

from crane_identification.diagnosis.constants import LEAST_DROP, LEAST_RUN, LEAST_TIME
from crane_identification.diagnosis.evidence import Evidence, Run, normed
from crane_identification.estimation.regression import LEAST_OPEN_SHARE
from crane_identification.signals.gated import thinned
from crane_model.errors import DataError
from crane_model.flow import (
    EDGES,
    InternalLeakage,
    Metered,
    OilCompressibility,
    Valve,
    WearRange,
    air_column,
    flow_regressor,
    of_chambers,
    piston_flow,
    worn_columns,
)
from crane_model.machine import Machine
from crane_model.record import Record

# The rows of the balance of flow of one joint, filtered like the torque.

SIGNALS = ("command", "pressure_a", "pressure_b", "supply_pressure", "tank_pressure")


class _Part(NamedTuple):
    """A part of a run in which all is known: its `gate` (samples,), `open` rows and valve."""

    run: Run
    gate: np.ndarray
    open: np.ndarray
    metered: Metered

    def rows(self, values: np.ndarray) -> np.ndarray:
        """Values (samples, k), filtered like the torque: (rows, k)."""
        return thinned(values * self.gate[:, np.newaxis], self.run.factor)[self.open]


class FlowRows:
    """Rows (N,) of the balance of one joint, both chambers: while it moves, and all is known.
    `recorded` and `known` are the times [s] of the recordings, and of their parts in which all
    SIGNALS are known.
    """

    def __init__(self, evidence: Evidence, joint: str) -> None:
        machine = evidence.model.machine
        if machine is None:
            raise DataError(f"flow of '{joint}': the model has no machine with cylinders")
        self.machine: Machine = machine
        self.joint = joint
        logged = [run for run in evidence.runs if _logged(run.record)]
        # with none of them, the first says what it lacks
        runs = [part for run in logged or evidence.runs[:1] for part in self._known(run)]
        self._parts = [self._part(run) for run in runs]
        self.recorded = sum(_duration(run.record) for run in evidence.runs)
        self.known = sum(_duration(run.record) for run in runs)
        self._require_motion()
        self.leak_and_oil = self._rows(
            lambda run: flow_regressor(
                (InternalLeakage(joint=joint), OilCompressibility(joint=joint)), run.record, machine
            )
        )
        flow = self._rows(lambda run: piston_flow(run.record, machine, joint)[..., np.newaxis])
        self.flow = flow[:, 0]
        self.air = self._rows(lambda run: air_column(run.record, machine, joint))

    @cached_property
    def wear_range(self) -> WearRange:
        places = [
            part.run.record.position[part.gate > 0.0, part.run.record.column(self.joint)]
            for part in self._parts
        ]
        return WearRange.of(np.concatenate(places))

    def worn(self, wear_range: WearRange) -> np.ndarray:
        """Columns (N, k) of a leakage that changes along a stroke, beside its mean."""
        return self._rows(
            lambda run: worn_columns(run.record, self.machine, self.joint, wear_range)
        )

    def edges(self, dead_bands: tuple[float, float], play: float = 0.0) -> np.ndarray:
        """Flow (N, 4) through each metering edge for K = 1."""
        valve = self._valve(dead_bands, play)
        return self._edge_rows(lambda part: valve.flows(part.metered))

    def edges_and_rates(self, dead_bands: tuple[float, float]) -> tuple[np.ndarray, np.ndarray]:
        """Flow (N, 4) without play, and its rate (N, 4), which a delay takes away."""
        valve = self._valve(dead_bands, 0.0)

        def columns(part: _Part) -> np.ndarray:
            flow = valve.flows(part.metered)
            return np.concatenate([flow, part.run.record.rate(flow)], axis=1)

        flow, rate = np.split(self._edge_rows(columns), 2, axis=1)
        return flow, rate

    def _valve(self, dead_bands: tuple[float, float], play: float) -> Valve:
        a, b = dead_bands
        return Valve(joint=self.joint, dead_band_a=a, dead_band_b=b, play=play)

    def _signal(self, record: Record, name: str) -> np.ndarray:
        values = record.needed(name, f"flow of '{self.joint}'")
        return values if values.ndim == 1 else values[:, record.column(self.joint)]

    def _known(self, run: Run) -> list[Run]:
        known = np.isfinite([self._signal(run.record, name) for name in SIGNALS]).all(axis=0)
        ends = np.flatnonzero(np.diff(known, prepend=False, append=False)).reshape(-1, 2)
        parts = [slice(begin, end) for begin, end in ends.tolist()]
        parts = [part for part in parts if _duration(run.record.take(part)) >= LEAST_RUN]
        return [replace(run, record=run.record.take(p), gate=run.gate[p]) for p in parts]

    def _metering(self, record: Record) -> np.ndarray:
        """Samples (samples,) at which both chambers are well between tank and supply."""
        chambers = self._signal(record, "pressure_a"), self._signal(record, "pressure_b")
        above = np.minimum(*chambers) - self._signal(record, "tank_pressure")
        below = self._signal(record, "supply_pressure") - np.maximum(*chambers)
        return np.minimum(above, below) > LEAST_DROP

    def _part(self, run: Run) -> _Part:
        gate = run.gate[:, run.record.column(self.joint)] * self._metering(run.record)
        metered = self._valve((0.0, 0.0), 0.0).metered(run.record, self.machine)
        return _Part(run, gate, thinned(gate, run.factor) > LEAST_OPEN_SHARE, metered)

    def _require_motion(self) -> None:
        up = down = 0.0
        for part in self._parts:
            record = part.run.record
            steps = np.diff(record.time, append=record.time[-1:]) * part.gate
            rising = record.velocity[:, record.column(self.joint)] > 0.0
            up, down = up + steps[rising].sum(), down + steps[~rising].sum()
        if min(up, down) < LEAST_TIME:
            cut = self.known < 0.9 * self.recorded
            raise DataError(
                f"flow of '{self.joint}': it moves up for {up:.0f} s and down for {down:.0f} s "
                f"with all signals known, {LEAST_TIME:.0f} s each needed; "
                + (
                    f"{', '.join(SIGNALS)} are known together for {self.known:.1f} s of "
                    f"{self.recorded:.1f} s: log them all along"
                    if cut
                    else "record longer, or move it more"
                )
            )

    def _rows(self, of: Callable[[Run], np.ndarray]) -> np.ndarray:
        """Values (samples, 2, k) of each run, filtered like the torque: (N, k)."""
        parts = []
        for part in self._parts:
            values = of(part.run)
            there = values.any(axis=0)  # columns of zeros cost nothing
            rows = np.zeros((np.count_nonzero(part.open), *there.shape))
            rows[:, there] = part.rows(values[:, there])
            parts.append(rows.reshape(-1, rows.shape[2]))
        return np.concatenate(parts)

    def _edge_rows(self, of: Callable[[_Part], np.ndarray]) -> np.ndarray:
        """Values (samples, k) of the edges in each part, once or several times: (N, k)."""
        rows = np.concatenate([part.rows(of(part)) for part in self._parts])
        return of_chambers(rows).reshape(-1, rows.shape[1])


def _logged(record: Record) -> bool:
    return all(getattr(record, name) is not None for name in SIGNALS)


def _duration(record: Record) -> float:
    return float(record.time[-1] - record.time[0]) if len(record) else 0.0


# The balance of flow of one joint: its columns, their least squares, and the proof of both.

WIDEST_DEAD_BAND = 0.3
WIDEST_PLAY = 0.2
DEAD_BAND_STEP = 0.005  # of a dead band, for its derivative
REFINING_STEPS, DEAD_BAND_ACCURACY = 10, 1e-5  # Gauss-Newton to the dead bands
LEAK, SOFT, PLAY, ZONES, COLUMNS = 4, 5, 8, (9, 10), 11
"""Columns of the balance: edges (4), leakage, oil (2), delay, play, the two dead bands."""
UNDETERMINED_SHARE = 1e-10  # of the largest eigenvalue: what is below is not determined


class FlowSolution(NamedTuple):
    """Parameters of columns and their covariance, which of them are determined, what is left."""

    values: np.ndarray
    covariance: np.ndarray
    determined: np.ndarray
    left: np.ndarray

    @property
    def rest(self) -> float:
        return power(self.left)


class Spool(NamedTuple):
    """Nonlinear values: dead bands and play; `gains` that weigh their changes and a delay."""

    dead_bands: tuple[float, float]
    play: float
    gains: np.ndarray

    def columns(self, rows: FlowRows) -> np.ndarray:
        """Columns (N, COLUMNS) of the balance, linear about these dead bands and play."""
        a, b = self.dead_bands
        edges, rates = rows.edges_and_rates((a, b))

        def change(dead_bands: tuple[float, float], play: float = 0.0) -> np.ndarray:
            return (rows.edges(dead_bands, play) - edges) @ self.gains

        beside = (
            rates @ self.gains,
            change((a, b), self.play),
            change((a + DEAD_BAND_STEP, b)) / DEAD_BAND_STEP,
            change((a, b + DEAD_BAND_STEP)) / DEAD_BAND_STEP,
        )
        return np.column_stack([edges, rows.leak_and_oil, *beside])


def searched(rows: FlowRows) -> Spool:
    """Dead bands and play with which least is left: one dead band first, then each way its own."""

    def common(x: float) -> FlowSolution:
        parts = (*rows.edges_and_rates((x, x)), rows.leak_and_oil)
        return solved(np.concatenate(parts, axis=1), rows.flow)

    x = _lowest(lambda x: common(x).rest, WIDEST_DEAD_BAND)
    spool = Spool((x, x), 0.0, common(x).values[: len(EDGES)])
    spool = _refined(rows, spool)
    stiff, edges = spool.columns(rows), rows.edges(spool.dead_bands)

    def left(play: float) -> float:
        stiff[:, PLAY] = (rows.edges(spool.dead_bands, play) - edges) @ spool.gains
        return solved(stiff, rows.flow).rest

    return _refined(rows, spool._replace(play=_lowest(left, WIDEST_PLAY)))


def _refined(rows: FlowRows, spool: Spool) -> Spool:
    """The spool with dead bands and gains of least squares, by Gauss-Newton."""
    for _ in range(REFINING_STEPS):
        values = solved(spool.columns(rows), rows.flow).values
        change = values[list(ZONES)]
        a, b = np.clip(spool.dead_bands + change, 0.0, WIDEST_DEAD_BAND).tolist()
        spool = spool._replace(dead_bands=(a, b), gains=values[: len(EDGES)])
        if np.abs(change).max() < DEAD_BAND_ACCURACY:
            break
    return spool


def _lowest(cost: Callable[[float], float], highest: float) -> float:
    """The value between 0.001 and `highest` at which the cost is lowest."""
    bounds, accuracy = (1e-3, highest), {"xatol": 1e-4}
    found = minimize_scalar(
        lambda x: cost(float(x)), bounds=bounds, method="bounded", options=accuracy
    )
    return float(found.x)


def solved(columns: np.ndarray, flow: np.ndarray) -> FlowSolution:
    """Least squares of flow (N,) on columns (N, k)."""
    scaled, norms = normed(columns)
    sizes, directions = np.linalg.eigh(scaled.T @ scaled)
    kept = sizes > UNDETERMINED_SHARE * sizes[-1]
    inverse = directions[:, kept] / sizes[kept] @ directions[:, kept].T
    values = inverse @ (scaled.T @ flow)
    left = flow - scaled @ values
    determined = (directions[:, ~kept] ** 2).sum(axis=1) < UNDETERMINED_SHARE
    covariance = power(left) * inverse / np.outer(norms, norms)
    return FlowSolution(values / norms, covariance, determined, left)


def power(values: np.ndarray) -> float:
    """Mean square, above 0."""
    return max(float((values**2).mean()), np.finfo(float).tiny)


@dataclass(frozen=True)
class Side:
    """Rows of a joint, and columns (N, k) that its balance has `further` on."""

    rows: FlowRows
    further: np.ndarray

    def columns(self, spool: Spool) -> np.ndarray:
        """Columns (N, COLUMNS + k) of the balance about this spool."""
        return np.column_stack([spool.columns(self.rows), self.further])


class ProvedBalance:
    """The balance of a joint, `fitted` to the rows `here` and proved by those `there`."""

    def __init__(self, here: Side, there: Side, spool: Spool) -> None:
        self.here, self.there, self.spool = here, there, spool
        self.columns, self.proof = here.columns(spool), there.columns(spool)
        self.fitted = solved(self.columns, here.rows.flow)
        self.least = power(there.rows.flow - self.proof @ self.fitted.values)
        self.flow_power = power(here.rows.flow)
        self.unexplained = float(np.sqrt(self.fitted.rest / self.flow_power))
        self.correlation = _correlation(self.fitted.left)

    def beside(self, here: np.ndarray, there: np.ndarray) -> tuple[float, np.ndarray]:
        """Share of the rest that further columns explain here and in the proof, and all values."""
        fit = solved(np.column_stack([self.columns, here]), self.here.rows.flow)
        proof = np.column_stack([self.proof, there])
        left = power(self.there.rows.flow - proof @ fit.values)
        return float(1.0 - max(fit.rest / self.fitted.rest, left / self.least)), fit.values

    def unit(self, column: int) -> np.ndarray:
        return np.eye(len(self.fitted.values))[column]

    def std_dev(self, gradient: np.ndarray) -> float:
        """Deviation of a function with this gradient (k,) of autoregressive noise, or infinite."""
        if not self.fitted.determined[gradient != 0.0].all():
            return float("inf")
        alike = max(self.correlation, 0.0)
        independent = float(np.sqrt(gradient @ self.fitted.covariance @ gradient))
        return float(np.sqrt((1.0 + alike) / (1.0 - alike))) * independent


def balance_of(here: FlowRows, there: FlowRows) -> ProvedBalance:
    """The balance with one leakage for all places."""
    first, second = (Side(rows, np.empty((len(rows.flow), 0))) for rows in (here, there))
    return ProvedBalance(first, second, searched(here))


def with_wear(plain: ProvedBalance, least_share: float) -> ProvedBalance:
    """The balance with a leakage along the stroke, if that explains enough of the rest."""
    here, there = plain.here.rows, plain.there.rows
    wear = [rows.worn(here.wear_range) for rows in (here, there)]
    share, values = plain.beside(*wear)
    if values[LEAK] <= 0.0 or share <= least_share:
        return plain
    return ProvedBalance(Side(here, wear[0]), Side(there, wear[1]), plain.spool)


def _correlation(left: np.ndarray) -> float:
    """Correlation of neighbouring rows (N,) of a chamber, below 1: 0.2 of filtered noise."""
    chambers = left.reshape(-1, 2)
    return float((chambers[1:] * chambers[:-1]).sum() / (chambers**2).sum())
