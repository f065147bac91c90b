"""The balance of flow of one joint: its columns, their least squares, and the proof of both."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.optimize import minimize_scalar

from crane_identification.diagnosis.fit.evidence import normed
from crane_identification.diagnosis.flow.flow_rows import FlowRows
from crane_model.flow.valve import EDGES

WIDEST_DEAD_ZONE = 0.3
WIDEST_PLAY = 0.2
STEP = 0.005  # of a dead zone, for its derivative
STEPS, ACCURACY = 10, 1e-5  # Gauss-Newton to the dead zones
LEAK, SOFT, PLAY, ZONES, COLUMNS = 4, 5, 8, (9, 10), 11
"""Columns of the balance: edges (4), leakage, oil (2), delay, play, the two dead zones."""
SINGULAR_SHARE = 1e-10  # of the largest eigenvalue: what is below is not determined


class FlowSolution(NamedTuple):
    """Parameters of columns and their covariance, which of them are determined, what is left."""

    values: np.ndarray
    covariance: np.ndarray
    determined: np.ndarray
    left: np.ndarray

    @property
    def rest(self) -> float:
        """Variance of what is left."""
        return power(self.left)


class Spool(NamedTuple):
    """What the balance is not linear in: dead zones of the two directions, play; and the gains of
    the edges that a delay, play and a change of the dead zones are weighed with.
    """

    dead_zones: tuple[float, float]
    play: float
    gains: np.ndarray

    def columns(self, rows: FlowRows) -> np.ndarray:
        """The columns (N, COLUMNS) of the balance, linear about these dead zones and play."""
        a, b = self.dead_zones
        edges, rates = rows.edges_and_rates((a, b))

        def change(dead_zones: tuple[float, float], play: float = 0.0) -> np.ndarray:
            return (rows.edges(dead_zones, play) - edges) @ self.gains

        beside = (
            rates @ self.gains,
            change((a, b), self.play),
            change((a + STEP, b)) / STEP,
            change((a, b + STEP)) / STEP,
        )
        return np.column_stack([edges, rows.leak_and_oil, *beside])


def searched(rows: FlowRows) -> Spool:
    """Dead zones and play with which least is left: one dead zone first, then each way its own."""

    def common(x: float) -> FlowSolution:
        parts = (*rows.edges_and_rates((x, x)), rows.leak_and_oil)
        return solved(np.concatenate(parts, axis=1), rows.flow)

    x = _lowest(lambda x: common(x).rest, WIDEST_DEAD_ZONE)
    spool = Spool((x, x), 0.0, common(x).values[: len(EDGES)])
    spool = _refined(rows, spool)
    stiff, edges = spool.columns(rows), rows.edges(spool.dead_zones)

    def left(play: float) -> float:
        stiff[:, PLAY] = (rows.edges(spool.dead_zones, play) - edges) @ spool.gains
        return solved(stiff, rows.flow).rest

    return _refined(rows, spool._replace(play=_lowest(left, WIDEST_PLAY)))


def _refined(rows: FlowRows, spool: Spool) -> Spool:
    """With the dead zones and gains of least squares, by Gauss-Newton."""
    for _ in range(STEPS):
        values = solved(spool.columns(rows), rows.flow).values
        change = values[list(ZONES)]
        a, b = np.clip(spool.dead_zones + change, 0.0, WIDEST_DEAD_ZONE).tolist()
        spool = spool._replace(dead_zones=(a, b), gains=values[: len(EDGES)])
        if np.abs(change).max() < ACCURACY:
            break
    return spool


def _lowest(cost: Callable[[float], float], highest: float) -> float:
    """Where the cost is lowest between 0.001 and `highest`."""
    bounds, accuracy = (1e-3, highest), {"xatol": 1e-4}
    found = minimize_scalar(
        lambda x: cost(float(x)), bounds=bounds, method="bounded", options=accuracy
    )
    return float(found.x)


def solved(columns: np.ndarray, flow: np.ndarray) -> FlowSolution:
    """Least squares of flow (N,) on columns (N, k)."""
    scaled, norms = normed(columns)
    sizes, directions = np.linalg.eigh(scaled.T @ scaled)
    kept = sizes > SINGULAR_SHARE * sizes[-1]
    inverse = directions[:, kept] / sizes[kept] @ directions[:, kept].T
    values = inverse @ (scaled.T @ flow)
    left = flow - scaled @ values
    determined = (directions[:, ~kept] ** 2).sum(axis=1) < SINGULAR_SHARE
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
        """(N, COLUMNS + k) of the balance about this spool."""
        return np.column_stack([spool.columns(self.rows), self.further])


class ProvedBalance:
    """The balance of a joint, `fitted` to the rows `here` and proved by those `there`.

    `columns` and `proof` are its columns of the two, `least` is the mean square left in the proof,
    `unexplained` the share of the flow (rms) that is left, and `correlation` that of neighbouring
    rows of what is left.
    """

    def __init__(self, here: Side, there: Side, spool: Spool) -> None:
        self.here, self.there, self.spool = here, there, spool
        self.columns, self.proof = here.columns(spool), there.columns(spool)
        self.fitted = solved(self.columns, here.rows.flow)
        self.least = power(there.rows.flow - self.proof @ self.fitted.values)
        self.flow_power = power(here.rows.flow)
        self.unexplained = float(np.sqrt(self.fitted.rest / self.flow_power))
        self.correlation = _correlation(self.fitted.left)

    def beside(self, here: np.ndarray, there: np.ndarray) -> tuple[float, np.ndarray]:
        """Share of what is left that further columns would explain, both here and in the proof, and
        the values of all.
        """
        fit = solved(np.column_stack([self.columns, here]), self.here.rows.flow)
        proof = np.column_stack([self.proof, there])
        left = power(self.there.rows.flow - proof @ fit.values)
        return float(1.0 - max(fit.rest / self.fitted.rest, left / self.least)), fit.values

    def unit(self, column: int) -> np.ndarray:
        """Gradient of a single parameter."""
        return np.eye(len(self.fitted.values))[column]

    def std_dev(self, gradient: np.ndarray) -> float:
        """Of a function of the parameters with this gradient (k,); infinite if it is not
        determined. Neighbouring rows of what is left are not independent, as of an autoregression
        of first order.
        """
        if not self.fitted.determined[gradient != 0.0].all():
            return float("inf")
        alike = max(self.correlation, 0.0)
        independent = float(np.sqrt(gradient @ self.fitted.covariance @ gradient))
        return float(np.sqrt((1.0 + alike) / (1.0 - alike))) * independent


def balance_of(here: FlowRows, there: FlowRows) -> ProvedBalance:
    """With one leakage for all places."""
    spool = searched(here)
    return ProvedBalance(_plain(here), _plain(there), spool)


def _plain(rows: FlowRows) -> Side:
    return Side(rows, np.empty((len(rows.flow), 0)))


def with_wear(plain: ProvedBalance, least_share: float) -> ProvedBalance:
    """The same with a leakage along the stroke, where that explains more than `least_share` of what
    is left; else as it is.
    """
    here, there = plain.here.rows, plain.there.rows
    wear = [rows.worn(here.wear_range) for rows in (here, there)]
    share, values = plain.beside(*wear)
    if values[LEAK] <= 0.0 or share <= least_share:
        return plain
    return ProvedBalance(Side(here, wear[0]), Side(there, wear[1]), plain.spool)


def _correlation(left: np.ndarray) -> float:
    """Of neighbouring rows (N,) of the same chamber, below 1: 0.2 of filtered noise."""
    chambers = left.reshape(-1, 2)
    return float((chambers[1:] * chambers[:-1]).sum() / (chambers**2).sum())
