"""A cylinder along the axis of a joint that slides."""

from typing import Literal

from crane_model.actuators.actuator import BuiltIn, proportional
from crane_model.actuators.hydraulic import CylinderActuator
from crane_model.configuration import Positive
from crane_model.linkages import Linkage


class DirectCylinder(BuiltIn, CylinderActuator):
    """x = `ratio` q: 1 for a telescope, 0.5 where a chain makes the joint go twice as far."""

    type: Literal["direct_cylinder"] = "direct_cylinder"
    ratio: Positive = 1.0

    @property
    def compiled(self) -> Linkage:
        """x = ratio q."""
        return proportional(self.ratio)
