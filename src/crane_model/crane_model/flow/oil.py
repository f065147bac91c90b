"""The oil: what leaks past the piston, and what the pressure squeezes."""

from typing import ClassVar, Literal

import numpy as np

from crane_model.cylinders import cylinder_length
from crane_model.flow.flow_term import FlowTerm
from crane_model.machine import Machine
from crane_model.record import Record
from crane_model.terms.effect import Effect
from crane_model.terms.term import Parameter


class InternalLeakage(FlowTerm):
    """Q_A = -C (p_A - p_B) = -Q_B: laminar leakage past the piston."""

    type: Literal["internal_leakage"] = "internal_leakage"
    effect: ClassVar[Effect] = Effect(
        "internal leakage",
        "flow from one chamber to the other with the difference of their pressures; creep at rest",
        ("valve_dead_zone", "valve_asymmetry"),
        "a load held with the valve closed and the lines shut off",
    )

    def flow_parameters(self) -> tuple[Parameter, ...]:
        """C."""
        return (Parameter("C_leak", "m3/(s Pa)", 0.0, "leakage past the piston"),)

    def columns(self, record: Record, machine: Machine) -> np.ndarray:
        """(n, 2, 1)."""
        drop = self.needed(record, "pressure_a") - self.needed(record, "pressure_b")
        return np.stack([-drop, drop], axis=1)[:, :, np.newaxis]


class OilCompressibility(FlowTerm):
    """Q = -(V/beta) p', V = swept volume + V_0, of each chamber: oil and hoses that give way.

    V_0, the volume in ports, hoses and the piston's rest, is the same for both chambers.
    """

    type: Literal["oil_compressibility"] = "oil_compressibility"
    effect: ClassVar[Effect] = Effect(
        "compressibility of the oil",
        "flow that does not move the piston where the pressures change",
        (),
        "steps of the command against a piston that is blocked",
    )

    def flow_parameters(self) -> tuple[Parameter, ...]:
        """1/beta, V_0/beta."""
        return (
            Parameter("inv_beta", "1/Pa", 0.0, "inverse of the bulk modulus"),
            Parameter("V0_beta", "m3/Pa", 0.0, "volume outside the stroke per bulk modulus"),
        )

    def columns(self, record: Record, machine: Machine) -> np.ndarray:
        """(n, 2, 2)."""
        cylinder = machine.cylinders[self.joint]
        q = record.position[:, record.column(self.joint)]
        length = cylinder_length(machine, self.joint, q)
        pressures = [self.needed(record, name) for name in ("pressure_a", "pressure_b")]
        rates = record.rate(np.stack(pressures, axis=1))
        swept = np.stack(
            [
                cylinder.area_a * (length - cylinder.length_min),
                cylinder.area_b * (cylinder.length_max - length),
            ],
            axis=1,
        )
        return -rates[:, :, np.newaxis] * np.stack([swept, np.ones_like(swept)], axis=2)
