"""Friction whose law over the speed is bent."""

from typing import ClassVar, Literal

import numpy as np
from pydantic import Field
from typing_extensions import override

from crane_model.array import Array
from crane_model.record import Record
from crane_model.terms.effect import Effect, Shape
from crane_model.terms.joint_term import JointTerm
from crane_model.terms.term import Family, Parameter


class Stribeck(JointTerm):
    """f_s sgn(q') exp(-(|q'|/speed)^exponent): Stribeck friction in the form of Bo and Pavelescu.

    Between dry and full lubrication friction falls with the speed; what is left at high speed is
    Coulomb friction (10).
    """

    type: Literal["stribeck"] = "stribeck"
    family: ClassVar[Family] = "friction"
    effect: ClassVar[Effect] = Effect(
        "Stribeck friction",
        "more friction near zero speed than above, in both directions",
        ("coulomb", "stiction", "presliding", "maxwell_slip", "viscous_quadratic"),
        "sweeps at several low constant speeds both ways",
        follows=("velocity",),
    )
    shapes: ClassVar[dict[str, Shape]] = {
        "speed": Shape(3e-3, 0.12, "rad/s or m/s", 8, "speed at which the excess has died out"),
        "exponent": Shape(1.0, 2.0, "1", 2, "how abruptly it dies out"),
    }

    speed: float = Field(gt=0)
    exponent: float = Field(gt=0)

    def column(self, record: Record, j: int) -> Array:
        """sgn(q') exp(-(|q'|/speed)^exponent)."""
        ratio = np.abs(record.velocity[:, j]) / self.speed
        return record.direction[:, j] * np.exp(-(ratio**self.exponent))

    @override
    def parameter(self, coordinate: str, force: str) -> Parameter:
        return Parameter("f_s", force, 0.0, "friction at zero speed beyond Coulomb friction")


class QuadraticViscous(JointTerm):
    """f_q q'|q'|: turbulent loss, above all that of oil in lines and ports."""

    type: Literal["viscous_quadratic"] = "viscous_quadratic"
    family: ClassVar[Family] = "friction"
    effect: ClassVar[Effect] = Effect(
        "quadratic viscous loss",
        "grows faster than the speed",
        ("stribeck", "viscous"),
        "sweeps at several constant speeds both ways, up to the fastest",
        follows=("velocity",),
    )

    def column(self, record: Record, j: int) -> Array:
        """q'|q'|."""
        v = record.velocity[:, j]
        return v * np.abs(v)

    @override
    def parameter(self, coordinate: str, force: str) -> Parameter:
        return Parameter("f_q", f"{force} s2/{coordinate}2", 0.0, "loss with the speed squared")
