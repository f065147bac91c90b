"""A cylinder that spans a joint directly: Fig. 5."""

import math
from typing import ClassVar, Literal

import numpy as np
from typing_extensions import override

from crane_model.actuators.actuator import BuiltIn
from crane_model.actuators.drawn import Bar, direction
from crane_model.actuators.hydraulic import CylinderActuator
from crane_model.angle import Direction
from crane_model.configuration import Positive
from crane_model.linkages import TRIANGLE, Linkage


class TriangleCylinder(BuiltIn, CylinderActuator):
    """The triangle of (20) between the joint and the cylinder's two pins [m, rad].

    In the plane across the joint's axis: the pin on the link before lies `j1` from the joint,
    `phi_4` from minus y of the joint's frame; the pin on the link itself `j2` from the joint,
    `phi_3` from x of the frame that turns with it. Both angles count the joint's way round.
    """

    bounded_by_pins: ClassVar[bool] = True
    type: Literal["triangle_cylinder"] = "triangle_cylinder"
    j1: Positive
    j2: Positive
    phi_3: Direction
    phi_4: Direction

    @property
    @override
    def compiled(self) -> Linkage:
        return Linkage(TRIANGLE, np.array([self.j1, self.j2, self.angle_0]))

    @property
    def angle_0(self) -> float:
        """The constant part of the angle in (20)."""
        return math.pi / 2 - self.phi_4 + self.phi_3

    @override
    def bars(self, q: float) -> tuple[Bar, ...]:
        base = self.j1 * direction(self.phi_4 - math.pi / 2)
        return (Bar(base, self.j2 * direction(self.phi_3 + q), True),)
