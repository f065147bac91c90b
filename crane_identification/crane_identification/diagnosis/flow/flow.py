"""The second residual: what the flow of oil tells of valves and oil, joint by joint.

Measured pressures are the input of the torque model, so that valves, leakage and compressibility
cannot show in its residual. They do in the balance of flow, which is fitted as a whole: every
machine has some of each, and an effect is missing where a value is not the usual one.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from crane_identification.diagnosis.fit.evidence import Evidence
from crane_identification.diagnosis.flow.flow_balance import (
    COLUMNS,
    LEAK,
    PLAY,
    SOFT,
    ZONES,
    FlowRows,
    Spool,
    power,
    searched,
    solved,
)
from crane_identification.diagnosis.flow.hydraulics import Flow, Flows, Gain, Quantity
from crane_identification.diagnosis.flow.usual import JointUsual, Usual, usual_of
from crane_identification.diagnosis.search.candidates import Candidate
from crane_identification.thresholds import Thresholds
from crane_model.errors import DataError
from crane_model.flow import FLOW_EFFECTS
from crane_model.flow.valve import EDGES, asymmetry, by_chamber


def examine(
    evidence: Evidence,
    held_out: Evidence,
    usual: Usual,
    thresholds: Thresholds,
    named: Sequence[Candidate] = (),
) -> Flows:
    """Each joint whose flow was recorded, and why effects are not observable on the others.

    An effect is missing where its value lies beyond what is usual, and where the usual value
    predicts the flow of the `held_out` recordings clearly worse. Where effects
    that are `named` are of sensors, what these measure tells nothing of the flow.
    """
    distrusted = {one.where for one in named if one.term.is_of_sensors()}
    found: list[Flow] = []
    absent: dict[tuple[str, str], str] = {}
    for joint in evidence.joints:
        try:
            here, there = FlowRows(evidence, joint), FlowRows(held_out, joint)
            if joint in distrusted:
                raise DataError(f"flow of '{joint}': its sensors may be wrong; settle that first")
            own = usual_of(joint, usual, evidence.model.hydraulics)
            found.append(_Examination(here, there, searched(here), own, thresholds).flow())
        except DataError as error:
            absent |= {(effect, joint): str(error) for effect in sorted(FLOW_EFFECTS)}
    return Flows(tuple(found), absent)


EFFECTS = {
    "dead_zones": "valve_dead_zone",
    "hysteresis": "valve_hysteresis",
    "asymmetry": "valve_asymmetry",
    "leakage": "internal_leakage",
    "bulk_modulus": "oil_compressibility",
}
"""What is called missing where a limit in `JointUsual` is passed, as in FLOW_EFFECTS."""

Tied = Callable[[FlowRows, np.ndarray], tuple[np.ndarray, np.ndarray | float]]
"""From rows and their columns to those of a balance with one quantity as it usually is, and the
part of the flow that is then known."""


class _Examination:
    """All quantities of a joint, from its balance `here`, proved `there`."""

    def __init__(
        self,
        here: FlowRows,
        there: FlowRows,
        spool: Spool,
        usual: JointUsual,
        thresholds: Thresholds,
    ) -> None:
        self._here, self._there, self._spool, self._usual = here, there, spool, usual
        self._gates, self._method = thresholds.gates, thresholds.method
        self._flow_power = power(here.flow)
        self._worn = False
        self._fit()
        if self._unexplained > self._gates.unexplained_flow and self._wears():
            self._worn = True
            self._fit()

    def _fit(self) -> None:
        """The balance with all that it has now."""
        here, there = self._here, self._there
        self._columns = self._columns_of(here, self._spool)
        self._proof = self._columns_of(there, self._spool)
        self._free = solved(self._columns, here.flow)
        self._correlation = _correlation(self._free.left)
        self._least = power(there.flow - self._proof @ self._free.values)
        self._unexplained = float(np.sqrt(self._free.rest / self._flow_power))

    def _columns_of(self, rows: FlowRows, spool: Spool) -> np.ndarray:
        """Of the balance; last, where the piston is worn, those of a leakage along the stroke."""
        columns = spool.columns(rows)
        return (
            np.column_stack([columns, rows.worn(self._here.wear_range)]) if self._worn else columns
        )

    def _wears(self) -> bool:
        """Whether a leakage that changes along the stroke explains most of what is left."""
        here, there = (rows.worn(self._here.wear_range) for rows in (self._here, self._there))
        share, values = self._further(here, there)
        return values[LEAK] > 0.0 and share > self._method.flow_named_share

    def flow(self) -> Flow:
        """What the balance says; `DataError` if it says nothing."""
        here, method, unexplained = self._here, self._method, self._unexplained
        noise = unexplained > method.flow_noise_share
        if noise and self._correlation < method.flow_law_correlation:
            raise DataError(
                f"flow of '{here.joint}': {unexplained:.0%} of it is noise, at most "
                f"{method.flow_noise_share:.0%} allowed; move faster"
            )
        gains = tuple(self._gain(k, edge) for k, edge in enumerate(EDGES))
        self._require_gains(gains)
        return Flow(
            joint=here.joint,
            quantities=() if noise else self._quantities(),
            gains=gains,
            unexplained=unexplained,
            usual=self._gates.unexplained_flow,
            correlation=self._correlation,
            air=self._air(),
            known=here.known,
            recorded=here.recorded,
            method=method,
        )

    def _air(self) -> float:
        """Share of what is left that air in the oil would explain."""
        share, values = self._further(self._here.air, self._there.air)
        return share if values[-1] > 0.0 else 0.0

    def _further(self, here: np.ndarray, there: np.ndarray) -> tuple[float, np.ndarray]:
        """Share of what is left that further columns would explain, both here and in the proof, and
        the values of all.
        """
        fit = solved(np.column_stack([self._columns, here]), self._here.flow)
        left = power(self._there.flow - np.column_stack([self._proof, there]) @ fit.values)
        return float(1.0 - max(fit.rest / self._free.rest, left / self._least)), fit.values

    def _gain(self, column: int, edge: str) -> Gain:
        value = float(self._free.values[column])
        std_dev = self._std_dev(self._unit(column))
        return Gain(edge, value, std_dev, abs(value) >= self._method.flow_sigmas * std_dev)

    def _require_gains(self, gains: Sequence[Gain]) -> None:
        known = [gain for gain in gains if gain.determined]
        wrong = [gain.edge for gain in known if gain.value < 0.0]
        if wrong or not known:
            raise DataError(
                f"flow of '{self._here.joint}': it does not follow the valve"
                + (f", and runs against it at the edge {', '.join(wrong)}" if wrong else "")
                + "; check sign and log of its command, and that its chambers are not exchanged"
            )

    def _unit(self, column: int) -> np.ndarray:
        """Gradient of a single parameter."""
        return np.eye(len(self._free.values))[column]

    def _std_dev(self, gradient: np.ndarray) -> float:
        """Of a function of the parameters with this gradient (k,); infinite if it is not
        determined. Neighbouring rows of what is left are not independent, as of an autoregression
        of first order.
        """
        if not self._free.determined[gradient != 0.0].all():
            return float("inf")
        alike = max(self._correlation, 0.0)
        independent = float(np.sqrt(gradient @ self._free.covariance @ gradient))
        return float(np.sqrt((1.0 + alike) / (1.0 - alike))) * independent

    def _quantities(self) -> tuple[Quantity, ...]:
        usual = self._usual
        return (
            self._dead_zone(),
            self._of_column("hysteresis", PLAY, self._spool.play, usual.hysteresis),
            self._asymmetry(),
            self._of_column("leakage", LEAK, 1.0, usual.leakage),
            self._of_column("bulk_modulus", SOFT, 1.0, 1.0 / usual.bulk_modulus),
        )

    def _dead_zone(self) -> Quantity:
        """Of the direction in which it is wider than usual, or nearer to that."""
        limits, zones = self._usual.dead_zones, self._spool.dead_zones
        a, b = (min(zone, limit) for zone, limit in zip(zones, limits, strict=True))
        usual = self._spool._replace(dead_zones=(a, b))
        beyond = [zone - limit for zone, limit in zip(zones, limits, strict=True)]
        fixed = [part for part, excess in zip(ZONES, beyond, strict=True) if excess > 0.0]

        def tied(rows: FlowRows, _: np.ndarray) -> tuple[np.ndarray, float]:
            return np.delete(self._columns_of(rows, usual), fixed, axis=1), 0.0

        k = int(np.argmax(beyond))
        std_dev = self._std_dev(self._unit(ZONES[k]))
        return self._judged("dead_zones", zones[k], std_dev, limits[k], tied)

    def _asymmetry(self) -> Quantity:
        (lowest, highest), gains = self._usual.asymmetry, self._free.values[: len(EDGES)]
        (mean_a, mean_b), shares = by_chamber(gains)
        value = asymmetry(gains)
        limit = highest if value > (lowest + highest) / 2.0 else lowest
        usual_a, usual_b = shares + (limit - value)
        gradient = np.zeros(len(self._free.values))
        gradient[:2] = gains[[1, 0]] * (1.0, -1.0) / (2.0 * mean_a) ** 2
        gradient[2:4] = gains[[3, 2]] * (-1.0, 1.0) / (2.0 * mean_b) ** 2

        def tied(_: FlowRows, columns: np.ndarray) -> tuple[np.ndarray, float]:
            supply_a, a_tank, supply_b, b_tank = columns[:, : len(EDGES)].T
            chambers = (
                (1.0 + usual_a) * supply_a + (1.0 - usual_a) * a_tank,
                (1.0 - usual_b) * supply_b + (1.0 + usual_b) * b_tank,
            )
            return np.column_stack([*chambers, columns[:, len(EDGES) :]]), 0.0

        std_dev = self._std_dev(gradient)
        beyond = value - limit if limit == highest else limit - value
        return self._judged("asymmetry", value, std_dev, limit, tied, beyond)

    def _of_column(self, name: str, part: int, unit: float, limit: float) -> Quantity:
        """Of a parameter that is the quantity over a `unit`."""
        value = float(self._free.values[part])
        fixed = limit / unit
        own = [part, *range(COLUMNS, len(self._free.values))] if part == LEAK else [part]

        def tied(_: FlowRows, columns: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            return np.delete(columns, own, axis=1), fixed * columns[:, part]

        std_dev = unit * self._std_dev(self._unit(part))
        judged = self._judged(name, unit * value, std_dev, limit, tied)
        return replace(judged, along_stroke=len(own) > 1)

    def _judged(
        self,
        name: str,
        value: float,
        std_dev: float,
        limit: float,
        tied: Tied,
        beyond: float | None = None,
    ) -> Quantity:
        """Beside the best balance in which the value, which lies `beyond` the limit, is usual."""
        sigmas = self._method.flow_sigmas * std_dev
        judged = Quantity(
            type=EFFECTS[name],
            value=value,
            std_dev=std_dev,
            usual=limit,
            own=name in self._usual.own,
            determined=sigmas <= max(abs(value), abs(limit)),
        )
        if not (value - limit if beyond is None else beyond) >= sigmas:
            return judged
        columns, known = tied(self._here, self._columns)
        fit = solved(columns, self._here.flow - known)
        columns, known = tied(self._there, self._proof)
        left = power(self._there.flow - known - columns @ fit.values)
        share = float(np.sqrt(max(fit.rest - self._free.rest, 0.0) / self._flow_power))
        score = len(self._here.flow) * float(np.log(fit.rest / self._free.rest))
        proved = left > self._method.flow_proof_factor * self._least
        missing = proved and share > self._gates.smallest_flow_share
        return replace(judged, share=share, score=score, missing=missing)


def _correlation(left: np.ndarray) -> float:
    """Of neighbouring rows (N,) of the same chamber, below 1: 0.2 of filtered noise."""
    chambers = left.reshape(-1, 2)
    return float((chambers[1:] * chambers[:-1]).sum() / (chambers**2).sum())
