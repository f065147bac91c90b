"""The valve: orifice flow of a spool through four metering edges, its overlap and its play."""

from typing import Literal, NamedTuple

import numpy as np
from numba import njit
from pydantic import Field

from crane_model.array import Array, Flags
from crane_model.cylinders import lever_arm
from crane_model.flow.flow_term import FlowTerm
from crane_model.machine import Machine
from crane_model.record import Record

EDGES = ("supply_a", "a_tank", "supply_b", "b_tank")
"""The metering edges of a valve, by what they join; the first and the last open together."""
SERVED = (0, 0, 1, 1)  # the chamber, A or B, that each of EDGES serves


class Metered(NamedTuple):
    """What a recording tells of a valve, whatever its dead zones and play: the command `u` (n,)
    towards chamber A, where runs begin (n,), and the root (n, 4) of the drop at each of EDGES.
    """

    u: Array
    first: Flags
    roots: Array


class Valve(FlowTerm):
    """Q = K x sqrt(pressure drop) at each edge, x the opening of the spool, K the edge's own.

    The spool y trails its command u, |y - u| <= play/2, and stands where u leaves it; a run begins
    with y = u. It feeds chamber A where y > dead_zone_a, chamber B where y < -dead_zone_b, and its
    opening x is what y is beyond.
    """

    type: Literal["valve"] = "valve"

    dead_zone_a: float = Field(default=0.0, ge=0, lt=1)
    dead_zone_b: float = Field(default=0.0, ge=0, lt=1)
    play: float = Field(default=0.0, ge=0, lt=1)

    def opening(self, record: Record, machine: Machine) -> Array:
        """x, positive where oil is let into chamber A: (n,)."""
        return self._opened(self._command(record, machine), record.first_of_run)

    def columns(self, record: Record, machine: Machine) -> Array:
        """(n, 2, 4) for K = 1 m3/(s Pa^0.5) of each of EDGES; an edge serves one chamber alone."""
        return of_chambers(self.flows(self.metered(record, machine)))

    def metered(self, record: Record, machine: Machine) -> Metered:
        """What does not depend on dead zones and play, to ask `flows` for several of them."""
        p_a, p_b = self.needed(record, "pressure_a"), self.needed(record, "pressure_b")
        supply, tank = self.needed(record, "supply_pressure"), self.needed(record, "tank_pressure")
        drops = np.stack([supply - p_a, p_a - tank, supply - p_b, p_b - tank], axis=1)
        return Metered(self._command(record, machine), record.first_of_run, _root(drops))

    def flows(self, metered: Metered) -> Array:
        """(n, 4) through each of EDGES into its chamber, for K = 1 m3/(s Pa^0.5)."""
        x = self._opened(metered.u, metered.first)
        feeds_a, feeds_b = np.maximum(0.0, x), np.maximum(0.0, -x)
        return np.stack([feeds_a, -feeds_b, feeds_b, -feeds_a], axis=1) * metered.roots

    def _command(self, record: Record, machine: Machine) -> Array:
        q = record.position[:, record.column(self.joint)]
        return self.needed(record, "command") * np.sign(lever_arm(machine, self.joint, q))

    def _opened(self, u: Array, first: Flags) -> Array:
        y = u if self.play == 0.0 else _trailing(u, self.play / 2.0, first)
        return np.maximum(0.0, y - self.dead_zone_a) + np.minimum(0.0, y + self.dead_zone_b)


def of_chambers(flows: Array) -> Array:
    """Columns (n, k) of EDGES, once or several times, as (n, 2, k): of the chamber that each edge
    serves.
    """
    out = np.zeros((len(flows), 2, flows.shape[1]))
    for column in range(flows.shape[1]):
        out[:, SERVED[column % len(EDGES)], column] = flows[:, column]
    return out


def by_chamber(gains: Array) -> tuple[Array, Array]:
    """Mean gain (2,) of the edges of chamber A and of B from those of all EDGES (4,), and by what
    share (2,) that is larger which opens where chamber A is fed: K = mean (1 +- share).
    """
    feeding_a, feeding_b = gains[[0, 3]], gains[[1, 2]]
    mean = (feeding_a + feeding_b) / 2.0
    return mean, (feeding_a - feeding_b) / (2.0 * mean)


def asymmetry(gains: Array) -> float:
    """Share by which the gains (4,) of EDGES are larger where chamber A is fed, mean of both
    chambers: none of a spool that is made for a differential cylinder, K_A / K_B = A_A / A_B.
    """
    return float(by_chamber(gains)[1].mean())


def _root(drop: Array) -> Array:
    return np.sign(drop) * np.sqrt(np.abs(drop))


@njit(cache=True)
def _trailing(u: Array, play: float, first: Flags) -> Array:
    y = u.copy()
    for k in range(1, len(u)):
        if not first[k]:
            y[k] = min(u[k] + play, max(u[k] - play, y[k - 1]))
    return y
