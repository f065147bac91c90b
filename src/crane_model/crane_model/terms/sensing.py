"""Errors of sensors: zeros of transducers, gain of one of two, zeros of encoders, late clocks."""

from dataclasses import replace
from typing import ClassVar, Literal

import numpy as np
from pydantic import Field

from crane_model.array import Array
from crane_model.errors import ConfigurationError
from crane_model.record import Record
from crane_model.terms.force_scale import MAX_SCALE_ERROR, USUAL_SCALE_ERROR, ForceScale, OfBodies
from crane_model.terms.gravity_and_load import planar_machine
from crane_model.terms.joint_term import (
    OneJointTerm,
    chamber_forces,
    cylinder_machine,
    gain_unit,
    lever,
    lever_and_slope,
)
from crane_model.terms.nonparametric import NonparametricTerm
from crane_model.terms.term import Effect, Parameter, Setting, Shape

# Readings of transducers that follow a force through some filter, whatever its form.

LEADS_S = (-0.1, -0.05, 0.0, 0.05, 0.1, 0.15, 0.2, 0.3)


class FilteredReading(NonparametricTerm):
    """sum_k w_k (F(t + lead_k) - F(t)) dx/dq: transducers behind a linear filter of any form (18).

    The machine felt F(t) + sum_k w_k (F(t + lead_k) - F(t)): all of a constant force, which tells
    a filter from a gain. A reading that is late shows at later instants what the machine felt, so
    that most weights are of leads; one of early pressures has weights of leads below zero. The
    knots are the leads [s].
    """

    type: Literal["filtered_reading"] = "filtered_reading"
    family = "sensing"
    said = "a force that follows the change of the measured force"
    draws = ("time_skew",)
    variable = "lead"
    spacing = LEADS_S
    kept = tuple(k for k, lead in enumerate(LEADS_S) if lead)
    times = ("F(t + lead) - F(t)",)

    knots: tuple[float, ...] = Field(examples=[LEADS_S])

    @classmethod
    def over(cls, x: Array) -> tuple[float, ...]:
        return LEADS_S

    @classmethod
    def followed(cls, record: Record, j: int) -> Array:
        return record.needed("force", "a shape of a filter")[:, j]

    def values_at_knot(self, k: int, coordinate: str, force: str) -> tuple[Parameter, ...]:
        meaning = f"weight of what is shown {self.knots[k]:g} s later"
        return (Parameter(f"w_lead_{k + 1}", "1", None, meaning),)

    def joint_columns(self, record: Record, setting: Setting, j: int) -> Array:
        arm = lever(setting, self.joint, record)
        leads = [self.knots[k] for k in self.kept]
        columns: Array = np.stack([led(self, record, arm, lead) for lead in leads], axis=1)
        return columns


def led(term: OneJointTerm, record: Record, arm: Array, lead: float) -> Array:
    """(F(t + lead) - F(t)) dx/dq (n,) on the joint of a term, whose lever `arm` (n,) is dx/dq."""
    j = record.column(term.joint)
    force = term.needed(record, "force")[:, j]
    if record.force_at is not None:
        later: Array = record.force_at(lead)[:, j] - force
        return later
    return arm * (record.shifted(force / arm, lead) - force / arm)


TOO_LARGE = "share by which the pressure of chamber {} is measured too large"
ANGLE_STEP_RAD = 1e-4  # of the difference with respect to an angle


class PressureOffset(OneJointTerm):
    """dp A_A dx/dq: a transducer of chamber A that reads dp too much (18), (19).

    One of chamber B that reads A_A/A_B dp too little looks the same.
    """

    type: Literal["pressure_offset"] = "pressure_offset"
    family = "sensing"
    effect = Effect(
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
    of_cylinder = True
    symbols = (Parameter("dp", "Pa", None, "reading of the transducer of chamber A at 0 Pa"),)

    def joint_columns(self, record: Record, setting: Setting, j: int) -> Array:
        machine = cylinder_machine(self, setting, self.joint)
        return machine.cylinders[self.joint].area_a * lever(setting, self.joint, record)


class ChamberGain(OneJointTerm):
    """-gain A_B p_B dx/dq: the transducer of chamber B off by a factor against that of A (19)."""

    type: Literal["chamber_gain"] = "chamber_gain"
    family = "sensing"
    effect = Effect(
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
        usual=USUAL_SCALE_ERROR,
        largest=MAX_SCALE_ERROR,
    )

    def joint_parameters(self, setting: Setting) -> tuple[Parameter, ...]:
        unit = gain_unit(setting, self.joint)
        return (Parameter("gain_B", unit, None, TOO_LARGE.format("B")),)

    def joint_columns(self, record: Record, setting: Setting, j: int) -> Array:
        return -chamber_forces(self, record, setting, self.joint)[:, 1]


class ChamberAGain(ForceScale):
    """gain (tau + A_B p_B dx/dq): the transducer of chamber A off by a factor (19).

    That is the force of chamber A. tau is that of `PressureGain`, so that beside it stands what the
    gain of chamber B would make of the other sign.
    """

    type: Literal["chamber_a_gain"] = "chamber_a_gain"
    family = "sensing"
    effect = Effect(
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
        "both transducers against a reference, at several pressures",
        law_of="chamber_gain",
        follows=("pressure of chamber B", "force"),
        usual=USUAL_SCALE_ERROR,
        largest=MAX_SCALE_ERROR,
    )
    of_cylinder = True
    symbols = (Parameter("gain_A", "1", None, TOO_LARGE.format("A")),)

    def joint_columns(self, record: Record, setting: Setting, j: int) -> Array:
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
    family = "sensing"
    effect = Effect(
        "zero of an encoder",
        "torque in proportion to the cylinder force times the slope of the lever arm",
        ("base_tilt", "hose_stiffness", "chamber_a_gain"),
        "the angle of the boom at rest, measured with an inclinometer",
        follows=("force", "position"),
    )

    def joint_parameters(self, setting: Setting) -> tuple[Parameter, ...]:
        if self.joint == planar_machine(self, setting).as_planar().joints[-1]:
            raise ConfigurationError(
                f"term '{self.type}': the lever arm of the telescope is constant, and its zero is "
                "part of the mass moments of the model"
            )
        return (Parameter("dq", "rad", None, "reading of the encoder at zero"),)

    def fill(self, record: Record, setting: Setting, columns: Array) -> None:
        super().fill(record, setting, columns)
        if any(self.bodies):
            columns[:, :, 0] -= self._slope_of_bodies(record, setting)

    def _slope_of_bodies(self, record: Record, setting: Setting) -> Array:
        """d/dq of (7), by central differences, (n, 3)."""
        turned = np.zeros_like(record.position)
        turned[:, record.column(self.joint)] = ANGLE_STEP_RAD
        after, before = (
            self.force_of_bodies(replace(record, position=q), setting)
            for q in (record.position + turned, record.position - turned)
        )
        return (after - before) / (2.0 * ANGLE_STEP_RAD)

    def joint_columns(self, record: Record, setting: Setting, j: int) -> Array:
        arm, slope = lever_and_slope(setting, self.joint, record)
        return self.needed(record, "force")[:, j] / arm * slope


class TimeSkew(OneJointTerm):
    """-delay (F(t + lead) - F(t))/lead dx/dq: pressures that are late beside positions (18).

    Where they are all `delay` late, so is the lead: the machine felt F(t + delay). Of a filter with
    that delay at low frequency, another lead comes nearer. A lead of 0 is -delay dF/dt dx/dq, where
    dF/dt is the given rate of the force, or else differences of the force within each run.
    """

    type: Literal["time_skew"] = "time_skew"
    family = "sensing"
    effect = Effect(
        "delay between pressures and encoders",
        "error in proportion to the rate of the force, the same delay on all joints of a bus",
        ("viscous", "presliding", "actuator_inertia", "boom_flexibility"),
        "one signal fed to both sensor channels at once",
        follows=("rate of the force",),
    )
    shapes = {"lead": Shape(0.01, 0.3, "s", 4, "time over which the force is taken to change")}

    symbols = (Parameter("delay", "s", None, "time by which pressures lag behind positions"),)

    lead: float = Field(default=0.0, ge=0)

    def joint_columns(self, record: Record, setting: Setting, j: int) -> Array:
        arm = lever(setting, self.joint, record)
        if self.lead > 0.0:
            return -led(self, record, arm, self.lead) / self.lead
        if record.force_rate is not None:
            return -record.force_rate[:, j]
        return -arm * record.rate(self.needed(record, "force")[:, j] / arm)


# Transducers that drift while the machine is on, as they do when they warm up or age.
#
# Time counts from the first recording of a session, where stamps tell.


class PressureDrift(OneJointTerm):
    """dp t A_A dx/dq: a transducer of chamber A whose zero drifts by dp a second (18), (19).

    One of chamber B that drifts by -dp A_A/A_B looks the same.
    """

    type: Literal["pressure_drift"] = "pressure_drift"
    family = "sensing"
    effect = Effect(
        "drift of a pressure transducer",
        "a force of the cylinder that grows with the time since the start, whatever the motion",
        ("pressure_offset", "chamber_gain_drift"),
        "readings of the transducers at zero pressure, of a cold and of a warm machine",
        law_of="pressure_offset",
        follows=("time", "position"),
    )
    of_cylinder = True
    symbols = (
        Parameter(
            "dp_drift", "Pa/s", None, "drift of the reading of the transducer of chamber A at 0 Pa"
        ),
    )

    def joint_columns(self, record: Record, setting: Setting, j: int) -> Array:
        offset = PressureOffset(joint=self.joint).joint_columns(record, setting, j)
        return offset * record.time


class ChamberGainDrift(ForceScale):
    """gain t (tau + A_B p_B dx/dq): a transducer of chamber A whose gain drifts with time (19)."""

    type: Literal["chamber_gain_drift"] = "chamber_gain_drift"
    family = "sensing"
    effect = Effect(
        "drifting gain of a pressure transducer",
        "force in proportion to the pressure of chamber A and to the time since the start",
        ("chamber_a_gain", "chamber_gain", "pressure_drift"),
        "both transducers against a reference, of a cold and of a warm machine",
        law_of="chamber_gain",
        follows=("time", "pressure of chamber B", "force"),
    )
    of_cylinder = True
    symbols = (Parameter("gain_A_drift", "1/s", None, f"drift of the {TOO_LARGE.format('A')}"),)

    def joint_columns(self, record: Record, setting: Setting, j: int) -> Array:
        gain = ChamberAGain(joint=self.joint, bodies=self.bodies)
        return gain.joint_columns(record, setting, j) * record.time


# Readings of transducers that are not in proportion to their own pressure: of no effect.

REFERENCE_PRESSURE_PA = 1e7  # at which the parameters of a bend say what it is


class BentReading(OneJointTerm):
    """(bend_A A_A p_A^2 - bend_B A_B p_B^2) dx/dq / 10 MPa: transducers whose reading bends (19).

    A gain is a straight line. The bend has none of its own: both lines together are the measured
    force, which explains itself.
    """

    type: Literal["bent_reading"] = "bent_reading"
    family = "sensing"
    unlisted_signature = "a force that bends with the pressure of a chamber"
    of_cylinder = True
    symbols = tuple(
        Parameter(f"bend_{chamber}", "1", None, f"{TOO_LARGE.format(chamber)} at 10 MPa")
        for chamber in "AB"
    )

    def joint_columns(self, record: Record, setting: Setting, j: int) -> Array:
        forces = chamber_forces(self, record, setting, self.joint) * [1.0, -1.0]
        pressures = [self.needed(record, name)[:, j] for name in ("pressure_a", "pressure_b")]
        return forces * np.stack(pressures, axis=1) / REFERENCE_PRESSURE_PA


class CurvedReadingOfA(OneJointTerm):
    """(curve p_A^2/10 MPa + twist p_A^3/(10 MPa)^2) A_A dx/dq (19): a reading that bends.

    Either way, of one chamber: those of both come close to two lines, which are the measured force.
    """

    type: Literal["curved_reading_a"] = "curved_reading_a"
    family = "sensing"
    unlisted_signature = "a force that bends with the pressure of chamber A"
    chamber: ClassVar[Literal["A", "B"]] = "A"

    def joint_parameters(self, setting: Setting) -> tuple[Parameter, ...]:
        cylinder_machine(self, setting, self.joint)
        meaning = f"of chamber {self.chamber}, share by which 10 MPa are measured too large"
        return (
            Parameter(f"curve_{self.chamber}", "1", None, f"{meaning}, as its square"),
            Parameter(f"twist_{self.chamber}", "1", None, f"{meaning}, as its cube"),
        )

    def joint_columns(self, record: Record, setting: Setting, j: int) -> Array:
        side = "AB".index(self.chamber)
        force = chamber_forces(self, record, setting, self.joint)[:, side] * (1.0, -1.0)[side]
        ratio = (
            self.needed(record, ("pressure_a", "pressure_b")[side])[:, j] / REFERENCE_PRESSURE_PA
        )
        columns: Array = np.stack([force * ratio, force * ratio**2], axis=1)
        return columns


class CurvedReadingOfB(CurvedReadingOfA):
    """-(curve p_B^2/10 MPa + twist p_B^3/(10 MPa)^2) A_B dx/dq: that of the other chamber (19)."""

    type: Literal["curved_reading_b"] = "curved_reading_b"  # type: ignore[assignment]
    unlisted_signature = "a force that bends with the pressure of chamber B"
    chamber: ClassVar[Literal["A", "B"]] = "B"


class OtherPressures(OneJointTerm):
    """share_k p_k A_A dx/dq (19): a transducer that picks up the chambers k of other joints."""

    type: Literal["other_pressures"] = "other_pressures"
    family = "sensing"
    unlisted_signature = "a force that follows the pressures of another joint's cylinder"

    def joint_parameters(self, setting: Setting) -> tuple[Parameter, ...]:
        return tuple(
            Parameter(
                f"share_{chamber}_{joint}",
                "1",
                None,
                f"share of the pressure of chamber {chamber} of {joint} that chamber A shows",
            )
            for joint in self._others(setting)
            for chamber in "AB"
        )

    def joint_columns(self, record: Record, setting: Setting, j: int) -> Array:
        machine = cylinder_machine(self, setting, self.joint)
        columns = [record.column(joint) for joint in self._others(setting)]
        pressures = [self.needed(record, name)[:, columns] for name in ("pressure_a", "pressure_b")]
        arm = lever(setting, self.joint, record) * machine.cylinders[self.joint].area_a
        heard: Array = np.stack(pressures, axis=2).reshape(len(record), -1) * arm[:, np.newaxis]
        return heard

    def _others(self, setting: Setting) -> list[str]:
        """The other joints of the model that have a cylinder."""
        machine = cylinder_machine(self, setting, self.joint)
        return [
            joint for joint in setting.units if joint in machine.cylinders and joint != self.joint
        ]


class VelocityLag(OneJointTerm):
    """sech^2(q'/speed) (c_1 q'/speed + c_2 q''): a velocity estimate that is wrong at reversals.

    A smoothed velocity passes zero too flat and at the wrong instant, so that sgn(q') of (10) jumps
    elsewhere than friction does. To first order that is d tanh(q'/speed) times an error of the
    velocity in proportion to q' and to q''. It looks like Stribeck friction and is there always.
    """

    type: Literal["velocity_lag"] = "velocity_lag"
    family = "sensing"
    nuisance = True
    shapes = {
        "speed": Shape(3e-3, 0.1, "rad/s or m/s", 5, "speed below which the estimate is wrong")
    }

    symbols = (
        Parameter("flat", "{force}", None, "friction misplaced by an error along the velocity"),
        Parameter("late", "{force} s2/{coordinate}", None, "friction misplaced by a delay"),
    )

    speed: float = Field(gt=0)

    def joint_columns(self, record: Record, setting: Setting, j: int) -> Array:
        ratio = record.velocity[:, j] / self.speed
        near = 1.0 / np.cosh(np.minimum(np.abs(ratio), 300.0)) ** 2
        return np.stack([near * ratio, near * record.acceleration[:, j]], axis=1)
