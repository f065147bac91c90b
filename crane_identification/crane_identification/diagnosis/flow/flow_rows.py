"""The rows of the balance of flow of one joint, filtered like the torque."""

from collections.abc import Callable
from dataclasses import replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from crane_identification.diagnosis.fit.evidence import Evidence
from crane_identification.diagnosis.fit.runs import Run, thinned
from crane_identification.estimation.regression import OPEN
from crane_model.errors import DataError
from crane_model.flow import flow_regressor, piston_flow
from crane_model.flow.oil import (
    InternalLeakage,
    OilCompressibility,
    WearRange,
    air_column,
    worn_columns,
)
from crane_model.flow.valve import Metered, Valve, of_chambers
from crane_model.machine import Machine
from crane_model.record import Record

LEAST_TIME = 8.0  # s of motion in either direction
LEAST_RUN = 1.0  # s; of what is shorter, the filter sees nothing but its ends
LEAST_DROP = 3e5  # Pa
"""From chambers to tank and supply. Below it, errors of transducers are as large as the drop, and a
chamber may be about to be empty and draw oil past the valve.
"""
SIGNALS = ("command", "pressure_a", "pressure_b", "supply_pressure", "tank_pressure")


class _Part(NamedTuple):
    """A run, or part of one, in which all is known: `gate` (samples,), which of its rows are
    `open`, and what its valve is asked with.
    """

    run: Run
    gate: np.ndarray
    open: np.ndarray
    metered: Metered

    def rows(self, values: np.ndarray) -> np.ndarray:
        """(rows, k) of values (samples, k), filtered like the torque."""
        return thinned(values * self.gate[:, np.newaxis], self.run.factor)[self.open]


class FlowRows:
    """Rows (N,) of the balance of one joint, both chambers: while it moves, and all is known.

    `recorded` and `known` are the times [s] of the recordings, and of their parts in which all
    SIGNALS are known. `DataError` says why nothing can be told.
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
        """Where the joint has been, as far as the balance is asked."""
        places = [
            part.run.record.position[part.gate > 0.0, part.run.record.column(self.joint)]
            for part in self._parts
        ]
        return WearRange.of(np.concatenate(places))

    def worn(self, wear_range: WearRange) -> np.ndarray:
        """(N, k) of a leakage that changes along a stroke, beside its mean."""
        return self._rows(
            lambda run: worn_columns(run.record, self.machine, self.joint, wear_range)
        )

    def edges(self, dead_zones: tuple[float, float], play: float = 0.0) -> np.ndarray:
        """(N, 4) flow through each metering edge for K = 1."""
        valve = self._valve(dead_zones, play)
        return self._edge_rows(lambda part: valve.flows(part.metered))

    def edges_and_rates(self, dead_zones: tuple[float, float]) -> tuple[np.ndarray, np.ndarray]:
        """The same without play, and its rate, which is what a delay takes away: (N, 4) each."""
        valve = self._valve(dead_zones, 0.0)

        def columns(part: _Part) -> np.ndarray:
            flow = valve.flows(part.metered)
            return np.concatenate([flow, part.run.record.rate(flow)], axis=1)

        flow, rate = np.split(self._edge_rows(columns), 2, axis=1)
        return flow, rate

    def _valve(self, dead_zones: tuple[float, float], play: float) -> Valve:
        a, b = dead_zones
        return Valve(joint=self.joint, dead_zone_a=a, dead_zone_b=b, play=play)

    def _signal(self, record: Record, name: str) -> np.ndarray:
        values = record.needed(name, f"flow of '{self.joint}'")
        return values if values.ndim == 1 else values[:, record.column(self.joint)]

    def _known(self, run: Run) -> list[Run]:
        """The parts of a run in which all signals are known."""
        known = np.isfinite([self._signal(run.record, name) for name in SIGNALS]).all(axis=0)
        ends = np.flatnonzero(np.diff(known, prepend=False, append=False)).reshape(-1, 2)
        parts = [slice(begin, end) for begin, end in ends.tolist()]
        parts = [part for part in parts if _duration(run.record.take(part)) >= LEAST_RUN]
        return [replace(run, record=run.record.take(p), gate=run.gate[p]) for p in parts]

    def _metering(self, record: Record) -> np.ndarray:
        """(samples,) where both chambers are well above the tank and well below the supply."""
        chambers = self._signal(record, "pressure_a"), self._signal(record, "pressure_b")
        above = np.minimum(*chambers) - self._signal(record, "tank_pressure")
        below = self._signal(record, "supply_pressure") - np.maximum(*chambers)
        return np.minimum(above, below) > LEAST_DROP

    def _part(self, run: Run) -> _Part:
        gate = run.gate[:, run.record.column(self.joint)] * self._metering(run.record)
        metered = self._valve((0.0, 0.0), 0.0).metered(run.record, self.machine)
        return _Part(run, gate, thinned(gate, run.factor) > OPEN, metered)

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
                f"where all is known, {LEAST_TIME:.0f} s each needed; "
                + (
                    f"{', '.join(SIGNALS)} are known together for {self.known:.1f} s of "
                    f"{self.recorded:.1f} s: log them all along"
                    if cut
                    else "record longer, or move it more"
                )
            )

    def _rows(self, of: Callable[[Run], np.ndarray]) -> np.ndarray:
        """(N, k) from (samples, 2, k) of each run, filtered like the torque."""
        parts = []
        for part in self._parts:
            values = of(part.run)
            there = values.any(axis=0)  # columns of zeros cost nothing
            rows = np.zeros((np.count_nonzero(part.open), *there.shape))
            rows[:, there] = part.rows(values[:, there])
            parts.append(rows.reshape(-1, rows.shape[2]))
        return np.concatenate(parts)

    def _edge_rows(self, of: Callable[[_Part], np.ndarray]) -> np.ndarray:
        """(N, k) from (samples, k) of the edges in each part, once or several times."""
        rows = np.concatenate([part.rows(of(part)) for part in self._parts])
        return of_chambers(rows).reshape(-1, rows.shape[1])


def _logged(record: Record) -> bool:
    return all(getattr(record, name) is not None for name in SIGNALS)


def _duration(record: Record) -> float:
    return float(record.time[-1] - record.time[0]) if len(record) else 0.0
