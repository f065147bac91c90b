"""Quantities of valve and oil of a joint, each beside the best balance in which it is as usual."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from crane_identification.diagnosis.flow.flow_balance import (
    COLUMNS,
    LEAK,
    PLAY,
    SOFT,
    ZONES,
    ProvedBalance,
    Side,
    power,
    solved,
)
from crane_identification.diagnosis.flow.hydraulics import Quantity
from crane_identification.diagnosis.flow.usual import JointUsual
from crane_identification.thresholds import Thresholds
from crane_model.flow.valve import EDGES, asymmetry, by_chamber

EFFECTS = {
    "dead_zones": "valve_dead_zone",
    "hysteresis": "valve_hysteresis",
    "asymmetry": "valve_asymmetry",
    "leakage": "internal_leakage",
    "bulk_modulus": "oil_compressibility",
}
"""What is called missing where a limit in `JointUsual` is passed, as in FLOW_EFFECTS."""

Tied = Callable[[Side, np.ndarray], tuple[np.ndarray, np.ndarray | float]]
"""From a side and its columns to those of a balance with one quantity as it usually is, and the
part of the flow that is then known."""


class Quantities:
    """Those of a joint's balance, beside what is usual of it."""

    def __init__(self, balance: ProvedBalance, usual: JointUsual, thresholds: Thresholds) -> None:
        self._balance, self._usual = balance, usual
        self._gates, self._method = thresholds.gates, thresholds.method

    def all(self) -> tuple[Quantity, ...]:
        """In the order of EFFECTS."""
        usual = self._usual
        return (
            self._dead_zone(),
            self._of_column("hysteresis", PLAY, self._balance.spool.play, usual.hysteresis),
            self._asymmetry(),
            self._of_column("leakage", LEAK, 1.0, usual.leakage),
            self._of_column("bulk_modulus", SOFT, 1.0, 1.0 / usual.bulk_modulus),
        )

    def _dead_zone(self) -> Quantity:
        """Of the direction in which it is wider than usual, or nearer to that."""
        balance = self._balance
        limits, zones = self._usual.dead_zones, balance.spool.dead_zones
        a, b = (min(zone, limit) for zone, limit in zip(zones, limits, strict=True))
        usual = balance.spool._replace(dead_zones=(a, b))
        beyond = [zone - limit for zone, limit in zip(zones, limits, strict=True)]
        fixed = [part for part, excess in zip(ZONES, beyond, strict=True) if excess > 0.0]

        def tied(side: Side, _: np.ndarray) -> tuple[np.ndarray, float]:
            return np.delete(side.columns(usual), fixed, axis=1), 0.0

        k = int(np.argmax(beyond))
        std_dev = balance.std_dev(balance.unit(ZONES[k]))
        return self._judged("dead_zones", zones[k], std_dev, limits[k], tied)

    def _asymmetry(self) -> Quantity:
        (lowest, highest), values = self._usual.asymmetry, self._balance.fitted.values
        gains = values[: len(EDGES)]
        (mean_a, mean_b), shares = by_chamber(gains)
        value = asymmetry(gains)
        limit = highest if value > (lowest + highest) / 2.0 else lowest
        usual_a, usual_b = shares + (limit - value)
        gradient = np.zeros(len(values))
        gradient[:2] = gains[[1, 0]] * (1.0, -1.0) / (2.0 * mean_a) ** 2
        gradient[2:4] = gains[[3, 2]] * (-1.0, 1.0) / (2.0 * mean_b) ** 2

        def tied(_: Side, columns: np.ndarray) -> tuple[np.ndarray, float]:
            supply_a, a_tank, supply_b, b_tank = columns[:, : len(EDGES)].T
            chambers = (
                (1.0 + usual_a) * supply_a + (1.0 - usual_a) * a_tank,
                (1.0 - usual_b) * supply_b + (1.0 + usual_b) * b_tank,
            )
            return np.column_stack([*chambers, columns[:, len(EDGES) :]]), 0.0

        std_dev = self._balance.std_dev(gradient)
        beyond = value - limit if limit == highest else limit - value
        return self._judged("asymmetry", value, std_dev, limit, tied, beyond)

    def _of_column(self, name: str, part: int, unit: float, limit: float) -> Quantity:
        """Of a parameter that is the quantity over a `unit`."""
        values = self._balance.fitted.values
        value = float(values[part])
        fixed = limit / unit
        own = [part, *range(COLUMNS, len(values))] if part == LEAK else [part]

        def tied(_: Side, columns: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            return np.delete(columns, own, axis=1), fixed * columns[:, part]

        std_dev = unit * self._balance.std_dev(self._balance.unit(part))
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
        balance = self._balance
        columns, known = tied(balance.here, balance.columns)
        flow, rest = balance.here.rows.flow, balance.fitted.rest
        fit = solved(columns, flow - known)
        columns, known = tied(balance.there, balance.proof)
        left = power(balance.there.rows.flow - known - columns @ fit.values)
        share = float(np.sqrt(max(fit.rest - rest, 0.0) / balance.flow_power))
        score = len(flow) * float(np.log(fit.rest / rest))
        proved = left > self._method.flow_proof_factor * balance.least
        missing = proved and share > self._gates.smallest_flow_share
        return replace(judged, share=share, score=score, missing=missing)
