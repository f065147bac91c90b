"""The valve: orifice flow of a spool, and how a real spool departs from it."""

from typing import ClassVar, Literal

import numpy as np
from numba import njit
from pydantic import Field

from crane_model.cylinders import lever_arm
from crane_model.flow.flow_term import FlowTerm
from crane_model.machine import Machine
from crane_model.record import Record
from crane_model.terms.effect import Effect, Shape
from crane_model.terms.term import Parameter

GAIN = "m3/(s Pa^0.5)"


class SpoolTerm(FlowTerm):
    """A term that is a flow through a spool, K times its opening times sqrt(pressure drop)."""

    def opening(self, record: Record, machine: Machine) -> np.ndarray:
        """The spool command u, positive where it lets oil into chamber A: (n,)."""
        q = record.position[:, record.column(self.joint)]
        return self.needed(record, "command") * np.sign(lever_arm(machine, self.joint, q))

    def orifice_flow(self, opening: np.ndarray, record: Record) -> np.ndarray:
        """Flow into A and B through a spool of K = 1 that is open by (n,): (n, 2)."""
        p_a, p_b = self.needed(record, "pressure_a"), self.needed(record, "pressure_b")
        supply, tank = self.needed(record, "supply_pressure"), self.needed(record, "tank_pressure")
        into = np.stack([_root(supply - p_a), -_root(p_b - tank)], axis=1)  # A fed, B drained
        out = np.stack([_root(p_a - tank), -_root(supply - p_b)], axis=1)
        u = opening[:, np.newaxis]
        return u * np.where(u > 0.0, into, out)


def _root(drop: np.ndarray) -> np.ndarray:
    return np.sign(drop) * np.sqrt(np.abs(drop))


class Valve(SpoolTerm):
    """Q = K u sqrt(pressure drop): a spool with sharp edges and no play."""

    type: Literal["valve"] = "valve"

    def flow_parameters(self) -> tuple[Parameter, ...]:
        """K."""
        return (Parameter("K", GAIN, 0.0, "gain of the valve, mean of both directions"),)

    def columns(self, record: Record, machine: Machine) -> np.ndarray:
        """(n, 2, 1)."""
        return self.orifice_flow(self.opening(record, machine), record)[:, :, np.newaxis]


class ValveAsymmetry(SpoolTerm):
    """Q = dK |u| sqrt(pressure drop): K + dK for u > 0, K - dK for u < 0."""

    type: Literal["valve_asymmetry"] = "valve_asymmetry"
    effect: ClassVar[Effect] = Effect(
        "asymmetric gain of a valve",
        "flow per command differs between the two directions",
        ("valve_dead_zone", "internal_leakage"),
        "steps of the command both ways, of several heights",
    )

    def flow_parameters(self) -> tuple[Parameter, ...]:
        """dK."""
        return (Parameter("dK", GAIN, None, "half the difference of the gain up and down"),)

    def columns(self, record: Record, machine: Machine) -> np.ndarray:
        """(n, 2, 1)."""
        u = self.opening(record, machine)
        return (np.sign(u)[:, np.newaxis] * self.orifice_flow(u, record))[:, :, np.newaxis]


class ValveDeadZone(SpoolTerm):
    """Q = K_d (dz(u) - u) sqrt(pressure drop), dz(u) = sgn(u) max(0, |u| - band): overlap.

    Beside a valve with K, K_d = K is a spool that opens beyond `band`.
    """

    type: Literal["valve_dead_zone"] = "valve_dead_zone"
    effect: ClassVar[Effect] = Effect(
        "dead zone of a valve",
        "no flow at small commands, and less by the same amount at all others",
        ("valve_asymmetry", "valve_hysteresis", "internal_leakage"),
        "slow ramps of the command through zero",
    )
    shapes: ClassVar[dict[str, Shape]] = {
        "band": Shape(0.01, 0.3, "1", 10, "command at which the spool opens")
    }

    band: float = Field(gt=0, lt=1)

    def flow_parameters(self) -> tuple[Parameter, ...]:
        """K_d."""
        return (Parameter("K_dead", GAIN, 0.0, "gain that the dead zone takes away"),)

    def columns(self, record: Record, machine: Machine) -> np.ndarray:
        """(n, 2, 1)."""
        u = self.opening(record, machine)
        open_beyond = np.sign(u) * np.maximum(0.0, np.abs(u) - self.band)
        missing = self.orifice_flow(open_beyond, record) - self.orifice_flow(u, record)
        return missing[:, :, np.newaxis]


class ValveHysteresis(SpoolTerm):
    """Q = K_h (y - u) sqrt(pressure drop), |y - u| <= width/2: the spool y trails its command u.

    Beside a valve with K, K_h = K is a spool with play; y stands where u leaves it. A run begins
    with y = u.
    """

    type: Literal["valve_hysteresis"] = "valve_hysteresis"
    effect: ClassVar[Effect] = Effect(
        "hysteresis of a valve",
        "flow depends on whether the command rises or falls",
        ("valve_dead_zone",),
        "slow triangles of the command, to and fro",
    )
    shapes: ClassVar[dict[str, Shape]] = {
        "width": Shape(0.01, 0.2, "1", 8, "play between command and spool")
    }

    width: float = Field(gt=0, lt=1)

    def flow_parameters(self) -> tuple[Parameter, ...]:
        """K_h."""
        return (Parameter("K_play", GAIN, 0.0, "gain times the share of the play that acts"),)

    def columns(self, record: Record, machine: Machine) -> np.ndarray:
        """(n, 2, 1)."""
        u = np.ascontiguousarray(self.opening(record, machine))
        spool = _trailing(u, self.width / 2.0, record.first_of_run)
        missing = self.orifice_flow(spool, record) - self.orifice_flow(u, record)
        return missing[:, :, np.newaxis]


@njit(cache=True)
def _trailing(u: np.ndarray, play: float, first: np.ndarray) -> np.ndarray:
    y = u.copy()
    for k in range(1, len(u)):
        if not first[k]:
            y[k] = min(u[k] + play, max(u[k] - play, y[k - 1]))
    return y
