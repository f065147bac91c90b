"""What transducers show of pressure without being in proportion to their own: of no effect."""

from typing import ClassVar, Literal

import numpy as np

from crane_model.array import Array
from crane_model.record import Record
from crane_model.terms.chambers import chamber_forces, cylinder_machine, lever
from crane_model.terms.joint_term import OneJointTerm
from crane_model.terms.term import Family, Parameter, Setting

REFERENCE = 1e7  # Pa, at which the parameters of a bend say what it is


class BentReading(OneJointTerm):
    """(bend_A A_A p_A^2 - bend_B A_B p_B^2) dx/dq / 10 MPa: transducers whose reading bends (19).

    A gain is a straight line. The bend has none of its own: both lines together are the measured
    force, which explains itself.
    """

    type: Literal["bent_reading"] = "bent_reading"
    family: ClassVar[Family] = "sensing"
    stranger: ClassVar[str] = "a force that bends with the pressure of a chamber"

    def joint_parameters(self, setting: Setting) -> tuple[Parameter, ...]:
        """One of each chamber."""
        cylinder_machine(self, setting, self.joint)
        return tuple(
            Parameter(
                f"bend_{chamber}",
                "1",
                None,
                f"share by which the pressure of chamber {chamber} is measured too large at 10 MPa",
            )
            for chamber in "AB"
        )

    def joint_columns(self, record: Record, setting: Setting, j: int) -> Array:
        """A p^2 dx/dq / 10 MPa of both chambers (n, 2)."""
        forces = chamber_forces(self, record, setting, self.joint) * [1.0, -1.0]
        pressures = [self.needed(record, name)[:, j] for name in ("pressure_a", "pressure_b")]
        return forces * np.stack(pressures, axis=1) / REFERENCE


class CurvedReadingOfA(OneJointTerm):
    """(curve p_A^2/10 MPa + twist p_A^3/(10 MPa)^2) A_A dx/dq (19): a reading that bends.

    Either way, of one chamber: those of both come close to two lines, which are the measured force.
    """

    type: Literal["curved_reading_a"] = "curved_reading_a"
    family: ClassVar[Family] = "sensing"
    stranger: ClassVar[str] = "a force that bends with the pressure of chamber A"
    chamber: ClassVar[Literal["A", "B"]] = "A"

    def joint_parameters(self, setting: Setting) -> tuple[Parameter, ...]:
        """Of the square and of the cube."""
        cylinder_machine(self, setting, self.joint)
        meaning = f"of chamber {self.chamber}, share by which 10 MPa are measured too large"
        return (
            Parameter(f"curve_{self.chamber}", "1", None, f"{meaning}, as its square"),
            Parameter(f"twist_{self.chamber}", "1", None, f"{meaning}, as its cube"),
        )

    def joint_columns(self, record: Record, setting: Setting, j: int) -> Array:
        """Those of the square and of the cube (n, 2); of chamber B against the force."""
        side = "AB".index(self.chamber)
        force = chamber_forces(self, record, setting, self.joint)[:, side] * (1.0, -1.0)[side]
        ratio = self.needed(record, ("pressure_a", "pressure_b")[side])[:, j] / REFERENCE
        columns: Array = np.stack([force * ratio, force * ratio**2], axis=1)
        return columns


class CurvedReadingOfB(CurvedReadingOfA):
    """-(curve p_B^2/10 MPa + twist p_B^3/(10 MPa)^2) A_B dx/dq: that of the other chamber (19)."""

    type: Literal["curved_reading_b"] = "curved_reading_b"  # type: ignore[assignment]
    stranger: ClassVar[str] = "a force that bends with the pressure of chamber B"
    chamber: ClassVar[Literal["A", "B"]] = "B"


class OtherPressures(OneJointTerm):
    """share_k p_k A_A dx/dq (19): a transducer that picks up the chambers k of other joints."""

    type: Literal["other_pressures"] = "other_pressures"
    family: ClassVar[Family] = "sensing"
    stranger: ClassVar[str] = "a force that follows the pressures of another joint's cylinder"

    def joint_parameters(self, setting: Setting) -> tuple[Parameter, ...]:
        """One of each chamber of each other cylinder."""
        return tuple(
            Parameter(
                f"share_{chamber}_{joint}",
                "1",
                None,
                f"share of the pressure of chamber {chamber} of {joint} that chamber A shows",
            )
            for joint in self._others(setting)
            for chamber in "AB"
        )

    def joint_columns(self, record: Record, setting: Setting, j: int) -> Array:
        """p_k A_A dx/dq (n, chambers)."""
        machine = cylinder_machine(self, setting, self.joint)
        columns = [record.column(joint) for joint in self._others(setting)]
        pressures = [self.needed(record, name)[:, columns] for name in ("pressure_a", "pressure_b")]
        arm = lever(setting, self.joint, record) * machine.cylinders[self.joint].area_a
        heard: Array = np.stack(pressures, axis=2).reshape(len(record), -1) * arm[:, np.newaxis]
        return heard

    def _others(self, setting: Setting) -> list[str]:
        """The other joints of the model that have a cylinder."""
        machine = cylinder_machine(self, setting, self.joint)
        return [one for one in setting.units if one in machine.cylinders and one != self.joint]
