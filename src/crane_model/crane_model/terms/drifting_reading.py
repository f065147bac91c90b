"""Transducers that drift while the machine is on, as they do when they warm up or age.

Time counts from the first recording of a session, where stamps tell.
"""

from typing import ClassVar, Literal

from typing_extensions import override

from crane_model.array import Array
from crane_model.record import Record
from crane_model.terms.chambers import cylinder_machine
from crane_model.terms.effect import Effect
from crane_model.terms.force_scale import ForceScale
from crane_model.terms.joint_term import OneJointTerm
from crane_model.terms.sensing import ChamberAGain, PressureOffset
from crane_model.terms.term import Family, Parameter, Setting


class PressureDrift(OneJointTerm):
    """dp t A_A dx/dq: a transducer of chamber A whose zero drifts by dp a second (18), (19).

    One of chamber B that drifts by -dp A_A/A_B looks the same.
    """

    type: Literal["pressure_drift"] = "pressure_drift"
    family: ClassVar[Family] = "sensing"
    effect: ClassVar[Effect] = Effect(
        "drift of a pressure transducer",
        "a force of the cylinder that grows with the time since the start, whatever the motion",
        ("pressure_offset", "chamber_gain_drift"),
        "readings of the transducers at zero pressure, of a cold and of a warm machine",
        law_of="pressure_offset",
        follows=("time", "position"),
    )

    @override
    def joint_parameters(self, setting: Setting) -> tuple[Parameter, ...]:
        cylinder_machine(self, setting, self.joint)
        meaning = "drift of the reading of the transducer of chamber A at 0 Pa"
        return (Parameter("dp_drift", "Pa/s", None, meaning),)

    def joint_columns(self, record: Record, setting: Setting, j: int) -> Array:
        """t A_A dx/dq."""
        offset = PressureOffset(joint=self.joint).joint_columns(record, setting, j)
        return offset * record.time


class ChamberGainDrift(ForceScale):
    """gain t (tau + A_B p_B dx/dq): a transducer of chamber A whose gain drifts with time (19)."""

    type: Literal["chamber_gain_drift"] = "chamber_gain_drift"
    family: ClassVar[Family] = "sensing"
    effect: ClassVar[Effect] = Effect(
        "drifting gain of a pressure transducer",
        "force in proportion to the pressure of chamber A and to the time since the start",
        ("chamber_a_gain", "chamber_gain", "pressure_drift"),
        "both transducers beside a reference, of a cold and of a warm machine",
        law_of="chamber_gain",
        follows=("time", "pressure of chamber B", "force"),
    )

    @override
    def joint_parameters(self, setting: Setting) -> tuple[Parameter, ...]:
        cylinder_machine(self, setting, self.joint)
        meaning = "drift of the share by which the pressure of chamber A is measured too large"
        return (Parameter("gain_A_drift", "1/s", None, meaning),)

    def joint_columns(self, record: Record, setting: Setting, j: int) -> Array:
        """t (tau + A_B p_B dx/dq)."""
        gain = ChamberAGain(joint=self.joint, bodies=self.bodies)
        return gain.joint_columns(record, setting, j) * record.time
