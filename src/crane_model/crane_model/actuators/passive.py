"""No actuator at all."""

from typing import ClassVar, Literal

from crane_model.actuators.actuator import BuiltIn, proportional
from crane_model.linkages import Linkage


class Passive(BuiltIn):
    """Nothing drives the joint, or nothing is known of what does: x = q."""

    drives: ClassVar[bool] = False
    type: Literal["passive"] = "passive"

    @property
    def compiled(self) -> Linkage:
        """x = q."""
        return proportional(1.0)
