"""Friction (10)-(16): Coulomb and viscous, each with its asymmetry between the two directions."""

from typing import ClassVar, Literal

import numpy as np
from typing_extensions import override

from crane_model.array import Array
from crane_model.record import Record
from crane_model.terms.effect import Effect
from crane_model.terms.joint_term import JointTerm
from crane_model.terms.term import Family, Parameter, Setting


class Coulomb(JointTerm):
    """f_c sgn(q'): first term of (13)."""

    type: Literal["coulomb"] = "coulomb"
    family: ClassVar[Family] = "friction"
    effect: ClassVar[Effect] = Effect(
        "Coulomb friction",
        "a step between the two directions of motion, the same at all speeds",
        ("stribeck", "presliding", "load_friction", "chamber_gain"),
        "slow sweeps at constant speed both ways",
        follows=("velocity",),
    )

    def column(self, record: Record, j: int) -> Array:
        """sgn(q'), 0 where the speed is below the resolution."""
        return record.direction[:, j]

    def slopes(self, record: Record, j: int, steepness: Array) -> Array:
        """Of sgn(q') that has been made smooth."""
        return _by_velocity(steepness)

    @override
    def parameter(self, coordinate: str, force: str) -> Parameter:
        return Parameter("f_c", force, 0.0, "Coulomb friction, mean of both directions")


class CoulombAsymmetry(JointTerm):
    """delta f_c: second term of (13), half the difference of Coulomb friction up and down."""

    type: Literal["coulomb_asymmetry"] = "coulomb_asymmetry"
    family: ClassVar[Family] = "friction"
    effect: ClassVar[Effect] = Effect(
        "asymmetry of Coulomb friction",
        "a constant force, whatever the motion",
        ("offset", "pressure_offset", "viscous_asymmetry", "chamber_gain"),
        "readings of the pressure transducers at zero pressure",
        ("viscous_asymmetry",),
    )
    asymmetry_of: ClassVar[str | None] = "coulomb"

    def column(self, record: Record, j: int) -> Array:
        """1, whatever the motion: (n,)."""
        return np.ones(len(record))

    def slopes(self, record: Record, j: int, steepness: Array) -> Array:
        """0: it does not follow the motion."""
        return _by_velocity(np.zeros(len(record)))

    @override
    def parameter(self, coordinate: str, force: str) -> Parameter:
        return Parameter("df_c", force, None, "asymmetry of Coulomb friction")


class Viscous(JointTerm):
    """f_v q': third term of (13)."""

    type: Literal["viscous"] = "viscous"
    family: ClassVar[Family] = "friction"
    effect: ClassVar[Effect] = Effect(
        "viscous friction",
        "grows in proportion to the speed",
        ("viscous_quadratic", "time_skew", "temperature_viscosity", "warm_up"),
        "sweeps at several constant speeds both ways",
        follows=("velocity",),
    )

    def column(self, record: Record, j: int) -> Array:
        """q'."""
        return record.velocity[:, j]

    def slopes(self, record: Record, j: int, steepness: Array) -> Array:
        """1 along q'."""
        return _by_velocity(np.ones(len(record)))

    @override
    def parameter(self, coordinate: str, force: str) -> Parameter:
        unit = f"{force} s/{coordinate}"
        return Parameter("f_v", unit, 0.0, "viscous friction, mean of both directions")


class ViscousAsymmetry(JointTerm):
    """delta f_v |q'|: fourth term of (13)."""

    type: Literal["viscous_asymmetry"] = "viscous_asymmetry"
    family: ClassVar[Family] = "friction"
    effect: ClassVar[Effect] = Effect(
        "asymmetry of viscous friction",
        "grows with the speed, with the same sign in both directions",
        ("coulomb_asymmetry", "temperature_viscosity", "warm_up"),
        "sweeps at several constant speeds both ways",
        ("coulomb_asymmetry",),
        follows=("velocity",),
    )
    asymmetry_of: ClassVar[str | None] = "viscous"

    def column(self, record: Record, j: int) -> Array:
        """|q'|."""
        return np.abs(record.velocity[:, j])

    def fill_smooth(self, record: Record, setting: Setting, columns: Array) -> None:
        """q' sgn(q') in place of |q'|."""
        j = record.column(self.joint)
        columns[:, j, 0] = record.velocity[:, j] * record.direction[:, j]

    def slopes(self, record: Record, j: int, steepness: Array) -> Array:
        """Of q' sgn(q')."""
        return _by_velocity(record.direction[:, j] + record.velocity[:, j] * steepness)

    @override
    def parameter(self, coordinate: str, force: str) -> Parameter:
        return Parameter("df_v", f"{force} s/{coordinate}", None, "asymmetry of viscous friction")


def _by_velocity(slope: Array) -> Array:
    """(3, n) of a column that depends on q' alone."""
    slopes = np.zeros((3, len(slope)))
    slopes[1] = slope
    return slopes
