"""Motors as actuators, electric and hydraulic, and joints that nothing drives."""

import math
from typing import ClassVar, Literal

from crane_model.actuators.actuator import BuiltIn, proportional
from crane_model.actuators.cylinders import Chambers, HydraulicActuator
from crane_model.configuration import NonNegative, Positive
from crane_model.linkages import Linkage

# An electric motor with a gear.


class ElectricDrive(BuiltIn):
    """x = `gear_ratio` q, the angle of the rotor [rad], so that its torque counts `gear_ratio`
    times at the joint; a negative ratio reverses.
    """

    has_rotor: ClassVar[bool] = True
    type: Literal["electric_drive"] = "electric_drive"
    gear_ratio: float  # rad of the rotor per rad or m of the joint
    rotor_inertia: NonNegative | None = None  # kg m2, where the data sheet gives it
    largest_torque: Positive | None = None  # N m of the motor

    @property
    def compiled(self) -> Linkage:
        """x = gear_ratio q."""
        return proportional(self.gear_ratio)


# A hydraulic motor that turns a joint.


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


# No actuator at all.


class Passive(BuiltIn):
    """Nothing drives the joint, or nothing is known of what does: x = q."""

    drives: ClassVar[bool] = False
    type: Literal["passive"] = "passive"

    @property
    def compiled(self) -> Linkage:
        """x = q."""
        return proportional(1.0)
