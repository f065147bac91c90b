"""Scales of the whole force of a joint: gains of its transducers, and the size of its linkage.

In a model with free masses such a column is nearly the measured force, which explains itself with a
factor of one. So it is taken from the force that the bodies ask for, if a model has them: free of
noise, and all that shows of a scale, since friction of the same joint takes up its own share.
Scales of all joints alike are a scale of all masses, which only a known weight shows; those of
single joints show if joints share the masses.
"""

from typing import ClassVar, Literal

import numpy as np
from pydantic import Field

from crane_model.array import Array
from crane_model.errors import ConfigurationError
from crane_model.record import Record
from crane_model.terms.joint_term import OneJointTerm, cylinder_machine
from crane_model.terms.rigid_body import BASE_PARAMETERS, PlanarRigidBody
from crane_model.terms.term import Effect, Parameter, Setting

USUAL_SCALE_ERROR = 0.005  # that a survey of pins and transducers of class 0.5 % leave
MAX_SCALE_ERROR = 0.7  # a transducer taken for one of the next range, as 250 for 400 bar, makes 0.6


class OfBodies(OneJointTerm):
    """A term on one joint that follows the forces (7) of the `bodies`, by their base parameters."""

    of_model = {"bodies": tuple(parameter.name for parameter in BASE_PARAMETERS)}

    bodies: tuple[float, ...] = Field(
        default=(0.0,) * len(BASE_PARAMETERS),
        min_length=len(BASE_PARAMETERS),
        max_length=len(BASE_PARAMETERS),
    )

    def force_of_bodies(self, record: Record, setting: Setting) -> Array:
        """(7) of the bodies: (n, j)."""
        return np.tensordot(PlanarRigidBody().columns(record, setting), self.bodies, axes=1)


class ForceScale(OfBodies):
    """A scale of the whole force of a joint; where no bodies are given, of the measured one."""

    effect: ClassVar[Effect]

    @classmethod
    def is_of_sensors(cls) -> bool:
        """A few percent of all pressures or lengths are a few percent of the gains of a valve: the
        balance of flow stays what it is. That of one chamber does not.
        """
        return super().is_of_sensors() and not cls.effect.formless

    def scaled(self, record: Record, setting: Setting, j: int) -> Array:
        """The force (n,) of joint j that the scale multiplies."""
        if any(self.bodies):
            return self.force_of_bodies(record, setting)[:, j]
        return self.needed(record, "force")[:, j]


class PressureGain(ForceScale):
    """gain tau: both transducers, or the piston areas of (19), off by one factor.

    tau is (7) of the `bodies` or, without them, the measured force. The latter is its own
    explanation: gain = 1 and no model at all fits every recording.
    """

    type: Literal["pressure_gain"] = "pressure_gain"
    family = "sensing"
    effect = Effect(
        "gain of the pressure transducers",
        "scales the whole force of a joint; if it is the same for all joints, it scales all masses",
        ("payload", "chamber_gain", "chamber_a_gain", "linkage_scale"),
        "both transducers against a reference at several pressures; if they are right, a survey of "
        "the linkages of the other joints, which may all be smaller or larger than in their file",
        follows=("force",),
        formless=True,
        usual=USUAL_SCALE_ERROR,
        largest=MAX_SCALE_ERROR,
    )
    symbols = (Parameter("gain", "1", None, "share by which the force is measured too large"),)

    def joint_columns(self, record: Record, setting: Setting, j: int) -> Array:
        return self.scaled(record, setting, j)


class LinkageScale(ForceScale):
    """-scale tau: a linkage whose lengths are all larger than in its file by one factor.

    At the same angle, x and dx/dq of (18) are then larger by that factor, and tau = F dx/dq is
    taken (1 - scale) times as large as it is. tau is that of `PressureGain`, from which no force
    tells it apart.
    """

    type: Literal["linkage_scale"] = "linkage_scale"
    family = "sensing"
    effect = Effect(
        "linkage of another size than in its file",
        "scales the whole force of a joint, whatever it comes from",
        ("pressure_gain", "chamber_gain", "chamber_a_gain"),
        "a survey of the pins of the linkage, and both transducers against a reference",
        follows=("force",),
        formless=True,
        usual=USUAL_SCALE_ERROR,
        largest=MAX_SCALE_ERROR,
    )

    def joint_parameters(self, setting: Setting) -> tuple[Parameter, ...]:
        machine = cylinder_machine(self, setting, self.joint)
        if not machine.actuators[self.joint].bounded_by_pins:
            raise ConfigurationError(
                f"term '{self.type}': the cylinder of joint '{self.joint}' turns nothing, so that "
                "it has no linkage"
            )
        meaning = "share of its true lengths by which the linkage is larger than in the file"
        return (Parameter("scale", "1", None, meaning),)

    def joint_columns(self, record: Record, setting: Setting, j: int) -> Array:
        return -self.scaled(record, setting, j)
