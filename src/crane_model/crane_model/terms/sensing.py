"""What sensors add: zeros of transducers, gain of one of two, zeros of encoders, late clocks."""

from dataclasses import replace
from typing import ClassVar, Literal

import numpy as np
from pydantic import Field
from typing_extensions import override

from crane_model.array import Array
from crane_model.errors import ConfigurationError
from crane_model.record import Record
from crane_model.terms.chambers import (
    chamber_forces,
    cylinder_machine,
    gain_unit,
    lever,
    lever_and_slope,
)
from crane_model.terms.effect import Effect, Shape
from crane_model.terms.filtered_reading import led
from crane_model.terms.force_scale import LARGEST_SCALE, USUAL_SCALE, ForceScale, OfBodies
from crane_model.terms.joint_term import OneJointTerm
from crane_model.terms.planar import planar_machine
from crane_model.terms.term import Family, Parameter, Setting

STEP = 1e-4  # rad, of the difference with respect to an angle


class PressureOffset(OneJointTerm):
    """dp A_A dx/dq: a transducer of chamber A that reads dp too much (18), (19).

    One of chamber B that reads A_A/A_B dp too little looks the same.
    """

    type: Literal["pressure_offset"] = "pressure_offset"
    family: ClassVar[Family] = "sensing"
    effect: ClassVar[Effect] = Effect(
        "offset of a pressure transducer",
        "a constant force of the cylinder, which the lever arm turns into one that follows q",
        (
            "coulomb_asymmetry",
            "offset",
            "hose_stiffness",
            "chamber_gain",
            "chamber_a_gain",
            "pressure_drift",
        ),
        "readings of the transducers at zero pressure",
        follows=("position",),
    )

    @override
    def joint_parameters(self, setting: Setting) -> tuple[Parameter, ...]:
        cylinder_machine(self, setting, self.joint)
        return (Parameter("dp", "Pa", None, "reading of the transducer of chamber A at 0 Pa"),)

    def joint_columns(self, record: Record, setting: Setting, j: int) -> Array:
        """A_A dx/dq."""
        machine = cylinder_machine(self, setting, self.joint)
        return machine.cylinders[self.joint].area_a * lever(setting, self.joint, record)


class ChamberGain(OneJointTerm):
    """-gain A_B p_B dx/dq: the transducer of chamber B off by a factor against that of A (19)."""

    type: Literal["chamber_gain"] = "chamber_gain"
    family: ClassVar[Family] = "sensing"
    effect: ClassVar[Effect] = Effect(
        "gain of one pressure transducer against the other",
        "force in proportion to the pressure of one chamber",
        (
            "chamber_a_gain",
            "pressure_gain",
            "linkage_scale",
            "pressure_offset",
            "seal_friction",
            "coulomb",
            "coulomb_asymmetry",
            "chamber_gain_drift",
        ),
        "both transducers on one pressure, at several pressures",
        follows=("pressure of chamber B",),
        usual=USUAL_SCALE,
        largest=LARGEST_SCALE,
    )

    @override
    def joint_parameters(self, setting: Setting) -> tuple[Parameter, ...]:
        unit = gain_unit(setting, self.joint)
        meaning = "share by which the pressure of chamber B is measured too large"
        return (Parameter("gain_B", unit, None, meaning),)

    def joint_columns(self, record: Record, setting: Setting, j: int) -> Array:
        """-A_B p_B dx/dq: the part of chamber B in (19)."""
        return -chamber_forces(self, record, setting, self.joint)[:, 1]


class ChamberAGain(ForceScale):
    """gain (tau + A_B p_B dx/dq): the transducer of chamber A off by a factor (19).

    That is the force of chamber A. tau is that of `PressureGain`, so that beside it stands what the
    gain of chamber B would make of the other sign.
    """

    type: Literal["chamber_a_gain"] = "chamber_a_gain"
    family: ClassVar[Family] = "sensing"
    effect: ClassVar[Effect] = Effect(
        "gain of the pressure transducer of chamber A",
        "force in proportion to the pressure of chamber A: that of chamber B, and the whole force",
        (
            "chamber_gain",
            "chamber_gain_drift",
            "pressure_gain",
            "linkage_scale",
            "pressure_offset",
            "encoder_offset",
        ),
        "both transducers beside a reference, at several pressures",
        law_of="chamber_gain",
        follows=("pressure of chamber B", "force"),
        usual=USUAL_SCALE,
        largest=LARGEST_SCALE,
    )

    @override
    def joint_parameters(self, setting: Setting) -> tuple[Parameter, ...]:
        cylinder_machine(self, setting, self.joint)
        meaning = "share by which the pressure of chamber A is measured too large"
        return (Parameter("gain_A", "1", None, meaning),)

    def joint_columns(self, record: Record, setting: Setting, j: int) -> Array:
        """tau + A_B p_B dx/dq."""
        in_b = chamber_forces(self, record, setting, self.joint)[:, 1]
        return self.scaled(record, setting, j) + in_b


class EncoderOffset(OfBodies):
    """dq (F d2x/dq2 - d/dq of (7)): an encoder that reads dq too much.

    The lever arm (18) is then taken at the wrong angle, which makes an error of the torque in
    proportion to the cylinder force F, and so are the forces (7) of the `bodies`, by their base
    parameters (8). One angle makes both: a free mass in the second would hold a tilt as well, which
    has no part in the first.
    """

    type: Literal["encoder_offset"] = "encoder_offset"
    family: ClassVar[Family] = "sensing"
    effect: ClassVar[Effect] = Effect(
        "zero of an encoder",
        "torque in proportion to the cylinder force times the slope of the lever arm",
        ("base_tilt", "hose_stiffness", "chamber_a_gain"),
        "the angle of the boom at rest, measured with an inclinometer",
        follows=("force", "position"),
    )

    @override
    def joint_parameters(self, setting: Setting) -> tuple[Parameter, ...]:
        if self.joint == planar_machine(self, setting).as_planar().joints[-1]:
            raise ConfigurationError(
                f"term '{self.type}': the lever arm of the telescope is constant, and its zero is "
                "part of the mass moments of the model"
            )
        return (Parameter("dq", "rad", None, "reading of the encoder at zero"),)

    def fill(self, record: Record, setting: Setting, columns: Array) -> None:
        """The lever arm on the joint itself, the bodies on all three."""
        super().fill(record, setting, columns)
        if any(self.bodies):
            columns[:, :, 0] -= self._slope_of_bodies(record, setting)

    def _slope_of_bodies(self, record: Record, setting: Setting) -> Array:
        """d/dq of (7), by central differences, (n, 3)."""
        turned = np.zeros_like(record.position)
        turned[:, record.column(self.joint)] = STEP
        after, before = (
            self.force_of_bodies(replace(record, position=q), setting)
            for q in (record.position + turned, record.position - turned)
        )
        return (after - before) / (2.0 * STEP)

    def joint_columns(self, record: Record, setting: Setting, j: int) -> Array:
        """F d2x/dq2."""
        arm, slope = lever_and_slope(setting, self.joint, record)
        return self.needed(record, "force")[:, j] / arm * slope


class TimeSkew(OneJointTerm):
    """-delay (F(t + lead) - F(t))/lead dx/dq: pressures that are late beside positions (18).

    Where they are all `delay` late, so is the lead: the machine felt F(t + delay). Of a filter with
    that delay at low frequency, another lead comes nearer. A lead of 0 is -delay dF/dt dx/dq, where
    dF/dt is the given rate of the force, or else differences of the force within each run.
    """

    type: Literal["time_skew"] = "time_skew"
    family: ClassVar[Family] = "sensing"
    effect: ClassVar[Effect] = Effect(
        "delay between pressures and encoders",
        "error in proportion to the rate of the force, the same delay on all joints of a bus",
        ("viscous", "presliding", "actuator_inertia", "boom_flexibility"),
        "one signal fed to both sensor channels at once",
        follows=("rate of the force",),
    )
    shapes: ClassVar[dict[str, Shape]] = {
        "lead": Shape(0.01, 0.3, "s", 4, "time over which the force is taken to change")
    }

    lead: float = Field(default=0.0, ge=0)

    @override
    def joint_parameters(self, setting: Setting) -> tuple[Parameter, ...]:
        return (Parameter("delay", "s", None, "time by which pressures lag behind positions"),)

    def joint_columns(self, record: Record, setting: Setting, j: int) -> Array:
        """-(F(t + lead) - F(t))/lead dx/dq."""
        arm = lever(setting, self.joint, record)
        if self.lead > 0.0:
            return -led(self, record, arm, self.lead) / self.lead
        if record.force_rate is not None:
            return -record.force_rate[:, j]
        return -arm * record.rate(self.needed(record, "force")[:, j] / arm)
