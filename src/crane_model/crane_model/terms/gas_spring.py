"""Gas springs, which carry a part of the weight of an arm."""

from typing import Annotated, ClassVar, Literal

import numpy as np
from pydantic import Field
from typing_extensions import override

from crane_model.angle import Angle
from crane_model.array import Array
from crane_model.configuration import Positive
from crane_model.errors import ConfigurationError
from crane_model.record import Record
from crane_model.terms.joint_term import JointTerm
from crane_model.terms.term import Family, Parameter, Setting


class GasSpring(JointTerm):
    """tau = s p A dL/dq: a piston between a pin `distance` from the joint and one on a `crank`.

    L^2 = distance^2 + crank^2 - 2 distance crank cos(q + angle) is the length between the pins, and
    p = `pressure` `volume` / (`volume` - A (L - distance + crank)) that of gas at one temperature,
    which the piston compresses as it is drawn out of its shortest length. s, the parameter, is 1 as
    the data sheet has it. Over a small range of q it can hardly be told from weight: give a prior.
    """

    type: Literal["gas_spring"] = "gas_spring"
    family: ClassVar[Family] = "gravity and load"

    distance: Annotated[Positive, Field(examples=[0.8])]  # m
    crank: Annotated[Positive, Field(examples=[0.2])]  # m
    angle: Annotated[Angle, Field(examples=[0.1])]  # of the crank to the far pin where q = 0
    area: Annotated[Positive, Field(examples=[1.7e-3])]  # m2 that the gas acts on
    pressure: Annotated[Positive, Field(examples=[16e6])]  # Pa at the shortest length
    volume: Annotated[Positive, Field(examples=[1e-3])]  # m3 there

    def joint_parameters(self, setting: Setting) -> tuple[Parameter, ...]:
        """s; `ConfigurationError` for a joint that does not turn."""
        if setting.units.get(self.joint) == "m":
            raise ConfigurationError(
                f"term 'gas_spring': joint '{self.joint}' slides; a gas spring works on a crank"
            )
        return super().joint_parameters(setting)

    def column(self, record: Record, j: int) -> Array:
        """p A dL/dq: (n,) [N m]; nan where the gas has no room left."""
        angle = record.position[:, j] + self.angle
        both = self.distance * self.crank
        length = np.sqrt(self.distance**2 + self.crank**2 - 2.0 * both * np.cos(angle))
        left = self.volume - self.area * (length - self.distance + self.crank)
        pressure = self.pressure * self.volume / np.where(left > 0.0, left, np.nan)
        torque: Array = pressure * self.area * both * np.sin(angle) / length
        return torque

    @override
    def parameter(self, coordinate: str, force: str) -> Parameter:
        return Parameter("gas_spring", "1", 0.0, "force of the gas spring over its data sheet's")
