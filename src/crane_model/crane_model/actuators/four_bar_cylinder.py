"""A cylinder that moves its joint through a four-bar linkage: Figs. 6-7."""

import math
from functools import cached_property
from typing import ClassVar, Literal, Self

import numpy as np
from pydantic import model_validator
from typing_extensions import override

from crane_model import linkages
from crane_model.actuators.actuator import BuiltIn
from crane_model.actuators.drawn import Bar, direction, meeting
from crane_model.actuators.hydraulic import CylinderActuator
from crane_model.angle import Direction
from crane_model.configuration import Positive
from crane_model.linkages import FOUR_BAR, Linkage


class FourBarCylinder(BuiltIn, CylinderActuator):
    """The four-bar linkage of (21)-(26) [m, rad]; letters as in `crane_model.linkages`.

    Extending lowers q; where it raises q, the linkage is `mirrored`: x(-q) of the same lengths.
    `pin_rise` is the direction of the cylinder's base seen from the joint, for pictures alone.
    """

    bounded_by_pins: ClassVar[bool] = True
    type: Literal["four_bar_cylinder"] = "four_bar_cylinder"
    s22: Positive
    s23: Positive
    c1: Positive
    c2: Positive
    s31: Positive
    s32: Positive
    beta_1: Direction
    gamma_25: Direction
    pin_rise: Direction
    mirrored: bool = False

    @model_validator(mode="after")
    def _triangle(self) -> Self:
        if not abs(self.s31 - self.s23) < self.s32 < self.s31 + self.s23:
            raise ValueError(
                f"s31 = {self.s31}, s23 = {self.s23} and s32 = {self.s32} must form a triangle: "
                f"s32 between {abs(self.s31 - self.s23):.6g} and {self.s31 + self.s23:.6g}"
            )
        return self

    @property
    def gamma_21_0(self) -> float:
        """The constant part of (21)."""
        return math.pi / 2 - self.beta_1 + self.gamma_25

    @cached_property
    def gamma_32(self) -> float:
        """(26), with the two lengths in their places."""
        return linkages.gamma_32(self.s31, self.s23, self.s32)

    @property
    @override
    def compiled(self) -> Linkage:
        lengths = self.s22, self.s23, self.c1, self.c2, self.s31
        sense = -1.0 if self.mirrored else 1.0
        return Linkage(FOUR_BAR, np.array([self.gamma_21_0, self.gamma_32, *lengths, sense]))

    def bars(self, q: float) -> tuple[Bar, ...]:
        """The cylinder from its base B to the eye K, and the links from there to P and R."""
        sense = -1.0 if self.mirrored else 1.0
        to_rocker = math.pi - self.pin_rise + self.gamma_32
        base = self.s31 * direction(math.pi - self.pin_rise)
        rocker = self.s23 * direction(to_rocker)
        lever = self.s22 * direction(to_rocker - self.gamma_21_0 + sense * q)
        eye = meeting(lever, self.c1, rocker, self.c2)
        pins = [np.array([1.0, sense]) * pin for pin in (base, eye, lever, rocker)]
        return (
            Bar(pins[0], pins[1], True),
            Bar(pins[1], pins[2], False),
            Bar(pins[1], pins[3], False),
        )
