"""An electric motor with a gear."""

from typing import ClassVar, Literal

from crane_model.actuators.actuator import BuiltIn, proportional
from crane_model.configuration import NonNegative, Positive
from crane_model.linkages import Linkage


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
