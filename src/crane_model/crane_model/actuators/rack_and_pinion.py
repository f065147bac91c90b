"""A cylinder whose piston is a rack that turns a pinion."""

from typing import Literal

from crane_model.actuators.actuator import BuiltIn, proportional
from crane_model.actuators.hydraulic import CylinderActuator
from crane_model.configuration import Positive
from crane_model.linkages import Linkage


class RackAndPinion(BuiltIn, CylinderActuator):
    """x = `rack_radius` q [m], 0 in the middle of the rack; areas as of a piston on either end."""

    type: Literal["rack_and_pinion"] = "rack_and_pinion"
    rack_radius: Positive  # m, of the pinion

    @property
    def compiled(self) -> Linkage:
        """x = r q."""
        return proportional(self.rack_radius)
