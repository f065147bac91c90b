"""A hydraulic motor that turns a joint."""

import math
from typing import ClassVar, Literal

from crane_model.actuators.actuator import BuiltIn, proportional
from crane_model.actuators.hydraulic import Chambers, HydraulicActuator
from crane_model.configuration import Positive
from crane_model.linkages import Linkage


class RotaryMotor(BuiltIn, HydraulicActuator):
    """x = `gear_ratio` q [rad] of the motor's shaft; its torque is `displacement` (p_A - p_B)."""

    has_rotor: ClassVar[bool] = True
    type: Literal["rotary_motor"] = "rotary_motor"
    displacement: Positive  # m3/rad
    gear_ratio: Positive = 1.0  # turns of the motor a turn of the joint

    @property
    def compiled(self) -> Linkage:
        """x = gear_ratio q."""
        return proportional(self.gear_ratio)

    @property
    def area_a(self) -> float:
        """The displacement [m3/rad]: volume that a turn of the shaft takes in."""
        return self.displacement

    @property
    def area_b(self) -> float:
        """As large as that of A."""
        return self.displacement

    @property
    def chambers(self) -> Chambers:
        """They stay as large as they are while it turns."""
        return Chambers(0.0, 0.0, 0.0, 0.0)

    @property
    def length_min(self) -> float:
        """None: it turns without end."""
        return -math.inf

    @property
    def length_max(self) -> float:
        """None: it turns without end."""
        return math.inf
