"""The balance of flow of one joint as rows: what its terms supply, filtered like the torque."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from crane_identification.diagnosis.evidence import Evidence, Run
from crane_identification.diagnosis.filtering import thinned
from crane_identification.estimation.regression import OPEN
from crane_model.errors import DataError
from crane_model.flow import flow_regressor, piston_flow
from crane_model.flow.oil import InternalLeakage, OilCompressibility
from crane_model.flow.valve import Valve
from crane_model.machine import Machine
from crane_model.record import Record

LEAST_TIME = 8.0  # s of motion in either direction
LEAST_RUN = 1.0  # s; of what is shorter, the filter sees nothing but its ends
LEAST_PRESSURE = 1e5  # Pa above the tank's, below which a chamber is about to be empty
SIGNALS = ("command", "pressure_a", "pressure_b", "supply_pressure", "tank_pressure")


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
        self._runs = [part for run in logged or evidence.runs[:1] for part in self._known(run)]
        self.recorded = sum(_duration(run.record) for run in evidence.runs)
        self.known = sum(_duration(run.record) for run in self._runs)
        self._require_motion()
        self.leak_and_oil = self._rows(
            lambda run: flow_regressor(
                (InternalLeakage(joint=joint), OilCompressibility(joint=joint)), run.record, machine
            )
        )
        flow = self._rows(lambda run: piston_flow(run.record, machine, joint)[..., np.newaxis])
        self.flow = flow[:, 0]

    def edges(self, dead_zones: tuple[float, float], play: float = 0.0) -> np.ndarray:
        """(N, 4) flow through each metering edge for K = 1."""
        valve = self._valve(dead_zones, play)
        return self._rows(lambda run: valve.columns(run.record, self.machine))

    def edges_and_rates(self, dead_zones: tuple[float, float]) -> tuple[np.ndarray, np.ndarray]:
        """The same without play, and its rate, which is what a delay takes away: (N, 4) each."""
        valve = self._valve(dead_zones, 0.0)

        def columns(run: Run) -> np.ndarray:
            flow = valve.columns(run.record, self.machine)
            return np.concatenate([flow, run.record.rate(flow)], axis=2)

        flow, rate = np.split(self._rows(columns), 2, axis=1)
        return flow, rate

    def correlation(self, left: np.ndarray) -> float:
        """Of neighbouring rows (N,) of the same chamber, below 1: 0.2 of filtered noise."""
        chambers = left.reshape(-1, 2)
        return float((chambers[1:] * chambers[:-1]).sum() / (chambers**2).sum())

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

    def _filled(self, record: Record) -> np.ndarray:
        """(samples,) where no chamber is about to be empty: then it draws oil past the valve."""
        lowest = np.minimum(self._signal(record, "pressure_a"), self._signal(record, "pressure_b"))
        return lowest > self._signal(record, "tank_pressure") + LEAST_PRESSURE

    def _gate(self, run: Run) -> np.ndarray:
        return run.gate[:, run.record.column(self.joint)] * self._filled(run.record)

    def _require_motion(self) -> None:
        up = down = 0.0
        for run in self._runs:
            record = run.record
            steps = np.diff(record.time, append=record.time[-1:]) * self._gate(run)
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
        for run in self._runs:
            gate, values = self._gate(run), of(run)
            open_ = thinned(gate, run.factor) > OPEN
            there = values.any(axis=0)  # columns of zeros cost nothing
            rows = np.zeros((np.count_nonzero(open_), *there.shape))
            rows[:, there] = thinned(values[:, there] * gate[:, np.newaxis], run.factor)[open_]
            parts.append(rows.reshape(-1, rows.shape[2]))
        return np.concatenate(parts)


def _logged(record: Record) -> bool:
    return all(getattr(record, name) is not None for name in SIGNALS)


def _duration(record: Record) -> float:
    return float(record.time[-1] - record.time[0]) if len(record) else 0.0
