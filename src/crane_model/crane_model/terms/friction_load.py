"""Friction that follows the load: on pins, seals and the telescope's pads."""

from dataclasses import replace
from typing import ClassVar, Literal

import numpy as np
from pydantic import Field
from typing_extensions import override

from crane_model.array import Array
from crane_model.errors import ConfigurationError
from crane_model.machine import Machine
from crane_model.record import Record
from crane_model.terms.chambers import chamber_forces, gain_unit
from crane_model.terms.effect import Effect
from crane_model.terms.force_scale import OfBodies
from crane_model.terms.joint_term import JointTerm, OneJointTerm
from crane_model.terms.planar import BoomDirections, planar_machine
from crane_model.terms.rigid_body import BASE_PARAMETERS
from crane_model.terms.term import Family, Parameter, Setting


class LoadFriction(JointTerm):
    """mu |tau| sgn(q'): friction of pins and bearings in proportion to the load they carry.

    The load is taken to be the measured generalized force.
    """

    type: Literal["load_friction"] = "load_friction"
    family: ClassVar[Family] = "friction"
    effect: ClassVar[Effect] = Effect(
        "load-dependent joint friction",
        "friction grows with the load, in both directions",
        ("coulomb", "seal_friction", "pad_friction", "position_friction"),
        "the same motion with raised back-pressure, and again with a known weight",
        kin=("weight_friction",),
        follows=("force",),
    )

    def column(self, record: Record, j: int) -> Array:
        """|tau| sgn(q')."""
        return record.direction[:, j] * np.abs(self.needed(record, "force")[:, j])

    @override
    def parameter(self, coordinate: str, force: str) -> Parameter:
        return Parameter("mu_load", "1", 0.0, "friction per load")


class WeightFriction(OfBodies):
    """mu |g(q)| sgn(q'): friction of pins and bearings in proportion to the weight they carry.

    g is (7) of the `bodies` at rest. The measured force, the load of `LoadFriction`, holds friction
    itself and what accelerates the joint.
    """

    type: Literal["weight_friction"] = "weight_friction"
    family: ClassVar[Family] = "friction"
    effect: ClassVar[Effect] = Effect(
        "joint friction by the weight",
        "friction grows with the weight on the joint, in both directions and at any acceleration",
        ("coulomb", "seal_friction", "pad_friction", "position_friction"),
        "the same motion with raised back-pressure, and again with a known weight",
        kin=("load_friction",),
        follows=("position",),
    )

    bodies: tuple[float, ...] = Field(
        default=(0.0,) * len(BASE_PARAMETERS),
        min_length=len(BASE_PARAMETERS),
        max_length=len(BASE_PARAMETERS),
        examples=[(30e3, 9e3, 1e3, 8e3, 3e3, 100.0, 500.0, 1e3)],
    )

    @override
    def joint_parameters(self, setting: Setting) -> tuple[Parameter, ...]:
        planar_machine(self, setting)
        return (Parameter("mu_weight", "1", 0.0, "friction per weight"),)

    def joint_columns(self, record: Record, setting: Setting, j: int) -> Array:
        """|g| sgn(q')."""
        still = np.zeros_like(record.velocity)
        rest = replace(record, velocity=still, acceleration=still)
        weight = self.force_of_bodies(rest, setting)[:, j]
        return record.direction[:, j] * np.abs(weight)


class SealFriction(OneJointTerm):
    """(mu_A A_A p_A + mu_B A_B p_B) |dx/dq| sgn(q'): pressure presses the seals on the bore.

    With A_A, A_B, p_A, p_B of (19) and the lever arm of (18); without a machine, all three are 1.
    """

    type: Literal["seal_friction"] = "seal_friction"
    family: ClassVar[Family] = "friction"
    effect: ClassVar[Effect] = Effect(
        "pressure-dependent seal friction",
        "friction follows the sum of the chamber pressures, not their difference",
        ("load_friction", "weight_friction", "chamber_gain", "position_friction"),
        "the same motion with raised back-pressure",
        follows=("pressure sum",),
    )

    @override
    def joint_parameters(self, setting: Setting) -> tuple[Parameter, ...]:
        unit = gain_unit(setting, self.joint)
        return (
            Parameter("mu_A", unit, 0.0, "seal friction per pressure force of chamber A"),
            Parameter("mu_B", unit, 0.0, "seal friction per pressure force of chamber B"),
        )

    def joint_columns(self, record: Record, setting: Setting, j: int) -> Array:
        """|F_A| sgn(q') and |F_B| sgn(q'), of the two chambers: (n, 2)."""
        forces = np.abs(chamber_forces(self, record, setting, self.joint))
        return record.direction[:, j, np.newaxis] * forces


class PadFriction(OneJointTerm):
    """g |cos psi| (m_0 + m_1 q4) sgn(q4'): the telescope slides on pads that carry its weight.

    psi = q2 + q3 is its inclination. With the extension its overhang grows and pads press harder:
    linear in q4, which no drawing of the pads is needed for.
    """

    type: Literal["pad_friction"] = "pad_friction"
    family: ClassVar[Family] = "friction"
    effect: ClassVar[Effect] = Effect(
        "telescope pad friction",
        "friction of the telescope falls with its inclination and grows with its extension",
        ("load_friction", "weight_friction", "position_friction"),
        "sweeps of the telescope at several inclinations of the outer boom",
        follows=("inclination of the telescope", "position"),
    )

    def joint_parameters(self, setting: Setting) -> tuple[Parameter, ...]:
        """m_0, m_1: friction coefficient times the mass that loads the pads."""
        on_pads(self, setting)
        return (
            Parameter("pad_0", "kg", 0.0, "friction coefficient times load of the pads at q4 = 0"),
            Parameter("pad_1", "kg/m", 0.0, "the same for each metre of extension"),
        )

    def joint_columns(self, record: Record, setting: Setting, j: int) -> Array:
        """g |cos psi| sgn(q') and q4 times that: (n, 2)."""
        pressed = pressing(on_pads(self, setting), record) * record.direction[:, j]
        return np.stack([pressed, pressed * record.position[:, j]], axis=1)


def on_pads(term: OneJointTerm, setting: Setting) -> Machine:
    """The machine; `ConfigurationError` unless the term is on its telescope."""
    machine = planar_machine(term, setting)
    telescope = machine.as_planar().joints[-1]
    if term.joint != telescope:
        raise ConfigurationError(
            f"term '{term.type}': only {telescope} slides on pads, got joint '{term.joint}'"
        )
    return machine


def pressing(machine: Machine, record: Record) -> Array:
    """g |cos psi| (n,): of the weight of the telescope, what presses on its pads."""
    _, psi, _ = BoomDirections.of(machine, record)
    pressed: Array = machine.gravity * np.abs(np.cos(psi))
    return pressed
