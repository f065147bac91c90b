"""Errors of the data that pass for physics: columns to put beside a model, never an answer."""

from typing import ClassVar, Literal

import numpy as np
from pydantic import Field
from typing_extensions import override

from crane_model.array import Array
from crane_model.record import Record
from crane_model.terms.joint_term import OneJointTerm
from crane_model.terms.term import Family, Parameter, Setting, Shape


class VelocityLag(OneJointTerm):
    """sech^2(q'/speed) (c_1 q'/speed + c_2 q''): a velocity estimate that is wrong at reversals.

    A smoothed velocity passes zero too flat and at the wrong instant, so that sgn(q') of (10) jumps
    elsewhere than friction does. To first order that is d tanh(q'/speed) times an error of the
    velocity in proportion to q' and to q''. It looks like Stribeck friction and is there always.
    """

    type: Literal["velocity_lag"] = "velocity_lag"
    family: ClassVar[Family] = "sensing"
    nuisance: ClassVar[bool] = True
    shapes: ClassVar[dict[str, Shape]] = {
        "speed": Shape(3e-3, 0.1, "rad/s or m/s", 5, "speed below which the estimate is wrong")
    }

    speed: float = Field(gt=0)

    @override
    def joint_parameters(self, setting: Setting) -> tuple[Parameter, ...]:
        force, unit = setting.force_unit(self.joint), setting.units[self.joint]
        return (
            Parameter("flat", force, None, "friction misplaced by an error along the velocity"),
            Parameter("late", f"{force} s2/{unit}", None, "friction misplaced by a delay"),
        )

    def joint_columns(self, record: Record, setting: Setting, j: int) -> Array:
        """sech^2 times q'/speed and times q'': (n, 2)."""
        ratio = record.velocity[:, j] / self.speed
        near = 1.0 / np.cosh(np.minimum(np.abs(ratio), 300.0)) ** 2
        return np.stack([near * ratio, near * record.acceleration[:, j]], axis=1)
