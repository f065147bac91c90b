"""The balance of flow of a cylinder: what its piston sweeps is what its terms supply.

    A_A x' =  Q_A(u, p) - C (p_A - p_B) - (V_A/beta) p_A'
   -A_B x' =  Q_B(u, p) + C (p_A - p_B) - (V_B/beta) p_B'

with areas A and pressures p of (19), the length x of (20) or (24), and flow Q positive into a
chamber. The left side is measured; on the right, each term is linear in its parameters. Measured
pressures are the input of the torque model, so that valves, leakage and oil cannot show in its
residual: they show here. The report leaves the hydraulics to future work (its section 5).
"""

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Literal, NamedTuple, Self

import numpy as np
from numba import njit
from pydantic import Field

from crane_model.array import Array, Flags
from crane_model.configuration import Schema
from crane_model.cylinders import cylinder_length, lever_arm
from crane_model.errors import DataError
from crane_model.machine import Machine
from crane_model.record import Record
from crane_model.terms.term import Effect


class FlowTerm(Schema, ABC):
    """A summand of the flow into the chambers of one cylinder, linear in its parameters."""

    type: str
    joint: str

    @abstractmethod
    def columns(self, record: Record, machine: Machine) -> Array:
        """Flow into chambers A and B for one unit of each parameter: (n, 2, parameters) [m3/s].

        `DataError` names a signal that the record does not have: then the effect is not observable.
        """

    def needed(self, record: Record, signal: str) -> Array:
        """(n,) of this joint, or of the machine; `DataError` if it was not recorded."""
        values = record.needed(signal, f"flow term '{self.type}'")
        return values if values.ndim == 1 else values[:, record.column(self.joint)]


def piston_flow(record: Record, machine: Machine, joint: str) -> Array:
    """A_A x' and -A_B x': (n, 2) [m3/s]; x' = dx/dq q' (18)."""
    j, cylinder = record.column(joint), machine.cylinders[joint]
    speed = lever_arm(machine, joint, record.position[:, j]) * record.velocity[:, j]
    return speed[:, np.newaxis] * (cylinder.area_a, -cylinder.area_b)


def flow_regressor(terms: Sequence[FlowTerm], record: Record, machine: Machine) -> Array:
    """Columns of the terms side by side, (n, 2, p), for the piston flow of their one joint.

    `DataError` if there is no term, or terms of several joints: their flows do not share a balance.
    """
    joints = {term.joint for term in terms}
    if len(joints) != 1:
        raise DataError(
            "flow balance: needs terms of one joint, got "
            + (", ".join(sorted(joints)) or "no term at all")
        )
    return np.concatenate([term.columns(record, machine) for term in terms], axis=2)


# The valve: orifice flow of a spool through four metering edges, its overlap and its play.

EDGES = ("supply_a", "a_tank", "supply_b", "b_tank")
"""The metering edges of a valve, by what they join; the first and the last open together."""
SERVED_CHAMBER = (0, 0, 1, 1)  # the chamber, A or B, that each of EDGES serves


class Metered(NamedTuple):
    """Data of a valve that do not depend on its dead bands and play: the command `u` (n,) towards
    chamber A, where runs begin (n,), and the root (n, 4) of the drop at each of EDGES.
    """

    u: Array
    first: Flags
    roots: Array


class Valve(FlowTerm):
    """Q = K x sqrt(pressure drop) at each edge, x the opening of the spool, K the edge's own.

    The spool y trails its command u, |y - u| <= play/2, and stands where u leaves it; a run begins
    with y = u. It feeds chamber A where y > dead_band_a, chamber B where y < -dead_band_b, and its
    opening x is what y is beyond.
    """

    type: Literal["valve"] = "valve"

    dead_band_a: float = Field(default=0.0, ge=0, lt=1)
    dead_band_b: float = Field(default=0.0, ge=0, lt=1)
    play: float = Field(default=0.0, ge=0, lt=1)

    def opening(self, record: Record, machine: Machine) -> Array:
        """x, positive where oil is let into chamber A: (n,)."""
        return self._opened(self._command(record, machine), record.first_of_run)

    def columns(self, record: Record, machine: Machine) -> Array:
        """(n, 2, 4) for K = 1 m3/(s Pa^0.5) of each of EDGES; an edge serves one chamber alone."""
        return of_chambers(self.flows(self.metered(record, machine)))

    def metered(self, record: Record, machine: Machine) -> Metered:
        """Data that do not depend on dead bands and play, to ask `flows` for several of them."""
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
        return np.maximum(0.0, y - self.dead_band_a) + np.minimum(0.0, y + self.dead_band_b)


def of_chambers(flows: Array) -> Array:
    """Columns (n, k) of EDGES, once or several times, as (n, 2, k): by the chamber of each edge."""
    out = np.zeros((len(flows), 2, flows.shape[1]))
    for column in range(flows.shape[1]):
        out[:, SERVED_CHAMBER[column % len(EDGES)], column] = flows[:, column]
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


# The oil: what leaks past the piston, and what the pressure squeezes.

ATMOSPHERE_PA = 101_325.0  # to which pressures are relative
WEAR_DEGREE = 4  # of the polynomial by which a leakage changes along a stroke


class InternalLeakage(FlowTerm):
    """Q_A = -C (p_A - p_B) = -Q_B: laminar leakage past the piston."""

    type: Literal["internal_leakage"] = "internal_leakage"

    def columns(self, record: Record, machine: Machine) -> Array:
        """(n, 2, 1) for C = 1 m3/(s Pa)."""
        drop = self.needed(record, "pressure_a") - self.needed(record, "pressure_b")
        return np.stack([-drop, drop], axis=1)[:, :, np.newaxis]


class OilCompressibility(FlowTerm):
    """Q = -((V + V_0)/beta) p' of each chamber, V swept by the piston: oil and hoses that give way.

    V_0 is in ports, hoses and the piston's rest, of each chamber its own.
    """

    type: Literal["oil_compressibility"] = "oil_compressibility"

    def columns(self, record: Record, machine: Machine) -> Array:
        """(n, 2, 3) for 1/beta [1/Pa] and V_0A/beta, V_0B/beta [m3/Pa] of 1."""
        cylinder = machine.cylinders[self.joint]
        q = record.position[:, record.column(self.joint)]
        length = cylinder_length(machine, self.joint, q)
        pressures = [self.needed(record, name) for name in ("pressure_a", "pressure_b")]
        rates = record.rate(np.stack(pressures, axis=1))
        columns = np.zeros((len(record), 2, 2))
        columns[:, 0, 0], columns[:, 1, 0] = cylinder.chambers.swept(length)
        columns[:, :, 1] = 1.0
        return -rates[:, :, np.newaxis] * columns


def air_column(record: Record, machine: Machine, joint: str) -> Array:
    """(n, 2, 1) for a share of 1 of air, at atmospheric pressure, in what the piston swept.

    It is squeezed isothermally, the more the lower the pressure.
    """
    term = OilCompressibility(joint=joint)
    chambers = [term.needed(record, name) for name in ("pressure_a", "pressure_b")]
    absolute = np.maximum(np.stack(chambers, axis=1), 0.0) + ATMOSPHERE_PA
    return term.columns(record, machine)[:, :, :1] * (ATMOSPHERE_PA / absolute**2)[:, :, np.newaxis]


class WearRange(NamedTuple):
    """Range of a joint [rad or m], and means (WEAR_DEGREE,) of the leakage's polynomials there."""

    low: float
    high: float
    means: Array

    @classmethod
    def of(cls, q: Array) -> Self:
        """That of positions (n,)."""
        whole = cls(float(q.min()), float(q.max()), np.zeros(WEAR_DEGREE))
        return whole._replace(means=whole.shapes(q).mean(axis=0))

    def shapes(self, q: Array) -> Array:
        """(n, WEAR_DEGREE): Chebyshev polynomials from the first degree on, less their means.

        Beyond either end they stay.
        """
        place = np.interp(q, [self.low, self.high], [-1.0, 1.0])
        return np.polynomial.chebyshev.chebvander(place, WEAR_DEGREE)[:, 1:] - self.means


def worn_columns(record: Record, machine: Machine, joint: str, wear_range: WearRange) -> Array:
    """(n, 2, WEAR_DEGREE) for a leakage that changes along a stroke by 1 m3/(s Pa)."""
    leak = InternalLeakage(joint=joint).columns(record, machine)
    return leak * wear_range.shapes(record.position[:, record.column(joint)])[:, np.newaxis]


# The catalogue of the flow balance: effects that show in the flow of oil, each by one value.


class FlowEffect(NamedTuple):
    """A physical effect, and the symbol and unit of the value that says how much of it there is."""

    effect: Effect
    symbol: str
    unit: str


FLOW_EFFECTS: Mapping[str, FlowEffect] = MappingProxyType(
    {
        "valve_dead_band": FlowEffect(
            Effect(
                "dead band of a valve",
                "no flow at small commands, and less by the same amount at all others",
                ("valve_asymmetry", "valve_hysteresis", "internal_leakage"),
                "slow ramps of the command through zero",
            ),
            "dead_band",
            "1",
        ),
        "valve_hysteresis": FlowEffect(
            Effect(
                "hysteresis of a valve",
                "flow depends on whether the command rises or falls",
                ("valve_dead_band",),
                "slow triangles of the command, to and fro",
            ),
            "play",
            "1",
        ),
        "valve_asymmetry": FlowEffect(
            Effect(
                "asymmetric gain of a valve",
                "flow per command differs between the two directions, at both chambers",
                ("valve_dead_band", "internal_leakage"),
                "steps of the command in both directions, of several heights",
            ),
            "asymmetry",
            "1",
        ),
        "internal_leakage": FlowEffect(
            Effect(
                "internal leakage",
                "flow from one chamber to the other with the difference of their pressures; "
                "creep at rest",
                ("valve_dead_band", "valve_asymmetry"),
                "a load held with the valve closed and the lines shut off",
            ),
            "C_leak",
            "m3/(s Pa)",
        ),
        "oil_compressibility": FlowEffect(
            Effect(
                "compressibility of the oil",
                "flow that does not move the piston where the pressures change",
                (),
                "steps of the command against a piston that is blocked",
            ),
            "inv_beta",
            "1/Pa",
        ),
    }
)


__all__ = ["FLOW_EFFECTS", "FlowEffect", "FlowTerm", "flow_regressor", "piston_flow"]
