"""The oil: what leaks past the piston, and what the pressure squeezes."""

from typing import Literal, NamedTuple, Self

import numpy as np

from crane_model.array import Array
from crane_model.cylinders import cylinder_length
from crane_model.flow.flow_term import FlowTerm
from crane_model.machine import Machine
from crane_model.record import Record

ATMOSPHERE = 101_325.0  # Pa, to which pressures are relative
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
    absolute = np.maximum(np.stack(chambers, axis=1), 0.0) + ATMOSPHERE
    return term.columns(record, machine)[:, :, :1] * (ATMOSPHERE / absolute**2)[:, :, np.newaxis]


class WearRange(NamedTuple):
    """Where a joint has been, from `low` to `high` [rad or m], and the means (WEAR_DEGREE,) there
    of the polynomials by which a leakage changes.
    """

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
