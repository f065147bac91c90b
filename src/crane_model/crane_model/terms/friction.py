"""Friction (10)-(16): Coulomb and viscous, each with its asymmetry between the two directions."""

from typing import ClassVar, Literal

from typing_extensions import override

from crane_model.motion_columns import MotionQuantity
from crane_model.terms.effect import Effect
from crane_model.terms.joint_term import ProportionalTerm
from crane_model.terms.term import Family, Parameter


class Coulomb(ProportionalTerm):
    """f_c sgn(q'): first term of (13)."""

    type: Literal["coulomb"] = "coulomb"
    family: ClassVar[Family] = "friction"
    effect: ClassVar[Effect] = Effect(
        "Coulomb friction",
        "a step between the two directions of motion, the same at all speeds",
        ("stribeck", "presliding", "load_friction", "weight_friction", "chamber_gain"),
        "slow sweeps at constant speed both ways",
        follows=("velocity",),
    )
    quantity: ClassVar[MotionQuantity] = MotionQuantity.DIRECTION

    @override
    def parameter(self, coordinate: str, force: str) -> Parameter:
        return Parameter("f_c", force, 0.0, "Coulomb friction, mean of both directions")


class CoulombAsymmetry(ProportionalTerm):
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
    quantity: ClassVar[MotionQuantity] = MotionQuantity.ONE

    @override
    def parameter(self, coordinate: str, force: str) -> Parameter:
        return Parameter("df_c", force, None, "asymmetry of Coulomb friction")


class Viscous(ProportionalTerm):
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
    quantity: ClassVar[MotionQuantity] = MotionQuantity.VELOCITY

    @override
    def parameter(self, coordinate: str, force: str) -> Parameter:
        unit = f"{force} s/{coordinate}"
        return Parameter("f_v", unit, 0.0, "viscous friction, mean of both directions")


class ViscousAsymmetry(ProportionalTerm):
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
    quantity: ClassVar[MotionQuantity] = MotionQuantity.SPEED

    @override
    def parameter(self, coordinate: str, force: str) -> Parameter:
        return Parameter("df_v", f"{force} s/{coordinate}", None, "asymmetry of viscous friction")
