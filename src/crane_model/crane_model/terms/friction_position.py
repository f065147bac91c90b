"""Friction that depends on where the joint stands."""

from typing import ClassVar, Literal

import numpy as np
from pydantic import Field
from typing_extensions import override

from crane_model.array import Array
from crane_model.record import Record
from crane_model.terms.effect import Effect, Shape
from crane_model.terms.joint_term import JointTerm, OneJointTerm
from crane_model.terms.term import Family, Parameter, Setting


class PositionFriction(JointTerm):
    """f_p q sgn(q'): Coulomb friction that changes along the way; its mean is that of (10)."""

    type: Literal["position_friction"] = "position_friction"
    family: ClassVar[Family] = "friction"
    effect: ClassVar[Effect] = Effect(
        "position-dependent Coulomb friction",
        "friction in both directions follows the position",
        (
            *("load_friction", "weight_friction", "seal_friction", "pad_friction"),
            *("cyclic_friction", "end_cushioning"),
        ),
        "slow sweeps both ways over the whole range, with and without a known weight",
        follows=("position",),
    )

    def column(self, record: Record, j: int) -> Array:
        """q sgn(q')."""
        return record.position[:, j] * record.direction[:, j]

    @override
    def parameter(self, coordinate: str, force: str) -> Parameter:
        return Parameter("f_p", f"{force}/{coordinate}", None, "change of Coulomb friction with q")


class CyclicFriction(OneJointTerm):
    """(f_1 sin(wave q) + f_2 cos(wave q)) sgn(q'): Coulomb friction in waves along the way."""

    type: Literal["cyclic_friction"] = "cyclic_friction"
    family: ClassVar[Family] = "friction"
    effect: ClassVar[Effect] = Effect(
        "Coulomb friction in waves",
        "friction in both directions waxes and wanes with the position",
        ("position_friction",),
        "slow sweeps both ways over the whole range",
        law_of="position_friction",
        follows=("position",),
    )
    shapes: ClassVar[dict[str, Shape]] = {
        "wave": Shape(
            3.0, 40.0, "rad/rad or rad/m", 16, "phase per rad or m of the joint", even=True
        )
    }

    wave: float = Field(gt=0)

    @override
    def joint_parameters(self, setting: Setting) -> tuple[Parameter, ...]:
        force = setting.force_unit(self.joint)
        return (
            Parameter("f_sin", force, None, "sine part of the wave of Coulomb friction"),
            Parameter("f_cos", force, None, "cosine part of the wave of Coulomb friction"),
        )

    def joint_columns(self, record: Record, setting: Setting, j: int) -> Array:
        """sin(wave q) sgn(q') and cos(wave q) sgn(q'): (n, 2)."""
        phase = self.wave * record.position[:, j]
        waves = np.stack([np.sin(phase), np.cos(phase)], axis=1)
        columns: Array = record.direction[:, j, np.newaxis] * waves
        return columns
