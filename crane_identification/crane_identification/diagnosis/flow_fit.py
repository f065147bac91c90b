"""Least squares on the balance of flow, and what the balance is not linear in."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from scipy.optimize import minimize_scalar

from crane_identification.diagnosis.flow_rows import FlowRows
from crane_identification.diagnosis.scaling import normed
from crane_model.flow.valve import EDGES

WIDEST_DEAD_ZONE = 0.3
WIDEST_PLAY = 0.2
STEP = 0.005  # of a dead zone, for its derivative
STEPS, ACCURACY = 10, 1e-5  # Gauss-Newton to the dead zones
LEAK, SOFT, PLAY, ZONES, COLUMNS = 4, 5, 8, (9, 10), 11
"""Columns of the balance: edges (4), leakage, oil (2), delay, play, the two dead zones."""
SINGULAR_SHARE = 1e-10  # of the largest eigenvalue: what is below is not determined


class Fit(NamedTuple):
    """Parameters of columns and their covariance, which of them are determined, what is left."""

    values: np.ndarray
    covariance: np.ndarray
    determined: np.ndarray
    left: np.ndarray

    @property
    def rest(self) -> float:
        """Variance of what is left."""
        return power(self.left)

    def std_dev(self, gradient: np.ndarray) -> float:
        """Of a function of the parameters with this gradient (k,); infinite if not determined."""
        if not self.determined[gradient != 0.0].all():
            return float("inf")
        return float(np.sqrt(gradient @ self.covariance @ gradient))


class Spool(NamedTuple):
    """What the balance is not linear in: dead zones of the two directions, play; and the gains of
    the edges that a delay, play and a change of the dead zones are weighed with.
    """

    dead_zones: tuple[float, float]
    play: float
    gains: np.ndarray

    def columns(self, rows: FlowRows) -> np.ndarray:
        """(N, COLUMNS)."""
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

    def common(x: float) -> Fit:
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


def solved(columns: np.ndarray, flow: np.ndarray) -> Fit:
    """Least squares of flow (N,) on columns (N, k)."""
    scaled, norms = normed(columns)
    sizes, directions = np.linalg.eigh(scaled.T @ scaled)
    kept = sizes > SINGULAR_SHARE * sizes[-1]
    inverse = directions[:, kept] / sizes[kept] @ directions[:, kept].T
    values = inverse @ (scaled.T @ flow)
    left = flow - scaled @ values
    determined = (directions[:, ~kept] ** 2).sum(axis=1) < SINGULAR_SHARE
    covariance = power(left) * inverse / np.outer(norms, norms)
    return Fit(values / norms, covariance, determined, left)


def power(values: np.ndarray) -> float:
    """Mean square, above 0."""
    return max(float((values**2).mean()), np.finfo(float).tiny)
