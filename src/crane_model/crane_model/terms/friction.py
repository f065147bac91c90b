"""Friction (10)-(16): Coulomb and viscous, each with its asymmetry between the two directions."""

from dataclasses import replace
from typing import Literal

import numpy as np
from pydantic import Field

from crane_model.array import Array
from crane_model.errors import ConfigurationError
from crane_model.machine import Machine
from crane_model.motion_columns import MotionQuantity
from crane_model.record import Record
from crane_model.terms.force_scale import OfBodies
from crane_model.terms.gravity_and_load import BoomDirections, planar_machine
from crane_model.terms.joint_term import (
    JointTerm,
    OneJointTerm,
    ProportionalTerm,
    chamber_forces,
    gain_unit,
)
from crane_model.terms.rigid_body import BASE_PARAMETERS
from crane_model.terms.term import Effect, Parameter, Setting, Shape


class Coulomb(ProportionalTerm):
    """f_c sgn(q'): first term of (13)."""

    type: Literal["coulomb"] = "coulomb"
    family = "friction"
    effect = Effect(
        "Coulomb friction",
        "a step between the two directions of motion, the same at all speeds",
        ("stribeck", "presliding", "load_friction", "weight_friction", "chamber_gain"),
        "slow sweeps at constant speed in both directions",
        follows=("velocity",),
    )
    quantity = MotionQuantity.DIRECTION
    symbol = Parameter("f_c", "{force}", 0.0, "Coulomb friction, mean of both directions")


class CoulombAsymmetry(ProportionalTerm):
    """delta f_c: second term of (13), half the difference of Coulomb friction up and down."""

    type: Literal["coulomb_asymmetry"] = "coulomb_asymmetry"
    family = "friction"
    effect = Effect(
        "asymmetry of Coulomb friction",
        "a constant force, whatever the motion",
        ("offset", "pressure_offset", "viscous_asymmetry", "chamber_gain"),
        "readings of the pressure transducers at zero pressure",
        ("viscous_asymmetry",),
    )
    asymmetry_of = "coulomb"
    quantity = MotionQuantity.ONE
    symbol = Parameter("df_c", "{force}", None, "asymmetry of Coulomb friction")


class Viscous(ProportionalTerm):
    """f_v q': third term of (13)."""

    type: Literal["viscous"] = "viscous"
    family = "friction"
    effect = Effect(
        "viscous friction",
        "grows in proportion to the speed",
        ("viscous_quadratic", "time_skew", "temperature_viscosity", "warm_up"),
        "sweeps at several constant speeds in both directions",
        follows=("velocity",),
    )
    quantity = MotionQuantity.VELOCITY
    symbol = Parameter(
        "f_v", "{force} s/{coordinate}", 0.0, "viscous friction, mean of both directions"
    )


class ViscousAsymmetry(ProportionalTerm):
    """delta f_v |q'|: fourth term of (13)."""

    type: Literal["viscous_asymmetry"] = "viscous_asymmetry"
    family = "friction"
    effect = Effect(
        "asymmetry of viscous friction",
        "grows with the speed, with the same sign in both directions",
        ("coulomb_asymmetry", "temperature_viscosity", "warm_up"),
        "sweeps at several constant speeds in both directions",
        ("coulomb_asymmetry",),
        follows=("velocity",),
    )
    asymmetry_of = "viscous"
    quantity = MotionQuantity.SPEED
    symbol = Parameter("df_v", "{force} s/{coordinate}", None, "asymmetry of viscous friction")


# Friction that depends on where the joint stands.


class PositionFriction(JointTerm):
    """f_p q sgn(q'): Coulomb friction that changes along the way; its mean is that of (10)."""

    type: Literal["position_friction"] = "position_friction"
    family = "friction"
    effect = Effect(
        "position-dependent Coulomb friction",
        "friction in both directions follows the position",
        (
            *("load_friction", "weight_friction", "seal_friction", "pad_friction"),
            *("cyclic_friction", "end_cushioning"),
        ),
        "slow sweeps in both directions over the whole range, with and without a known weight",
        follows=("position",),
    )
    symbol = Parameter("f_p", "{force}/{coordinate}", None, "change of Coulomb friction with q")

    def column(self, record: Record, j: int) -> Array:
        return record.position[:, j] * record.direction[:, j]


class CyclicFriction(OneJointTerm):
    """(f_1 sin(wave q) + f_2 cos(wave q)) sgn(q'): Coulomb friction in waves along the way."""

    type: Literal["cyclic_friction"] = "cyclic_friction"
    family = "friction"
    effect = Effect(
        "Coulomb friction in waves",
        "friction in both directions waxes and wanes with the position",
        ("position_friction",),
        "slow sweeps in both directions over the whole range",
        law_of="position_friction",
        follows=("position",),
    )
    shapes = {
        "wave": Shape(
            3.0, 40.0, "rad/rad or rad/m", 16, "phase per rad or m of the joint", even=True
        )
    }

    symbols = (
        Parameter("f_sin", "{force}", None, "sine part of the wave of Coulomb friction"),
        Parameter("f_cos", "{force}", None, "cosine part of the wave of Coulomb friction"),
    )

    wave: float = Field(gt=0)

    def joint_columns(self, record: Record, setting: Setting, j: int) -> Array:
        phase = self.wave * record.position[:, j]
        waves = np.stack([np.sin(phase), np.cos(phase)], axis=1)
        columns: Array = record.direction[:, j, np.newaxis] * waves
        return columns


# Friction whose law over the speed is bent.


class Stribeck(JointTerm):
    """f_s sgn(q') exp(-(|q'|/speed)^exponent): Stribeck friction in the form of Bo and Pavelescu.

    Between dry and full lubrication friction falls with the speed; what is left at high speed is
    Coulomb friction (10).
    """

    type: Literal["stribeck"] = "stribeck"
    family = "friction"
    effect = Effect(
        "Stribeck friction",
        "more friction near zero speed than above, in both directions",
        ("coulomb", "stiction", "presliding", "maxwell_slip", "viscous_quadratic"),
        "sweeps at several low constant speeds in both directions",
        follows=("velocity",),
    )
    shapes = {
        "speed": Shape(3e-3, 0.12, "rad/s or m/s", 8, "speed at which the excess has died out"),
        "exponent": Shape(1.0, 2.0, "1", 2, "how abruptly it dies out"),
    }
    symbol = Parameter("f_s", "{force}", 0.0, "friction at zero speed beyond Coulomb friction")

    speed: float = Field(gt=0)
    exponent: float = Field(gt=0)

    def column(self, record: Record, j: int) -> Array:
        ratio = np.abs(record.velocity[:, j]) / self.speed
        return record.direction[:, j] * np.exp(-(ratio**self.exponent))


class QuadraticViscous(JointTerm):
    """f_q q'|q'|: turbulent loss, above all that of oil in lines and ports."""

    type: Literal["viscous_quadratic"] = "viscous_quadratic"
    family = "friction"
    effect = Effect(
        "quadratic viscous loss",
        "grows faster than the speed",
        ("stribeck", "viscous"),
        "sweeps at several constant speeds in both directions, up to the fastest",
        follows=("velocity",),
    )
    symbol = Parameter("f_q", "{force} s2/{coordinate}2", 0.0, "loss with the speed squared")

    def column(self, record: Record, j: int) -> Array:
        v = record.velocity[:, j]
        return v * np.abs(v)


# Viscous friction that falls as the oil warms up.

WORKING_TEMPERATURE_C = 40.0  # deg C: where nothing is added to viscous friction (10)


class TemperatureViscosity(JointTerm):
    """-f_T (T - 40 deg C) q': viscous friction that falls with the measured oil temperature T."""

    type: Literal["temperature_viscosity"] = "temperature_viscosity"
    family = "friction"
    effect = Effect(
        "temperature-dependent viscosity",
        "viscous friction falls as the oil temperature rises",
        ("viscous", "viscous_asymmetry", "warm_up"),
        "the same motion with cold and with warm oil",
        follows=("temperature", "velocity"),
    )
    symbol = Parameter(
        "f_T", "{force} s/({coordinate} degC)", 0.0, "viscous friction lost with each degree"
    )

    def column(self, record: Record, j: int) -> Array:
        return (WORKING_TEMPERATURE_C - self.needed(record, "temperature")) * record.velocity[:, j]


class WarmUp(JointTerm):
    """f_w q' exp(-(t - since)/warming): viscous friction that dies out while the machine works.

    For recordings without an oil temperature. t counts from the first recording of a session, where
    stamps tell; `since` [s] is when the machine was cold.
    """

    type: Literal["warm_up"] = "warm_up"
    family = "friction"
    effect = Effect(
        "viscosity of oil that warms up",
        "viscous friction falls with the time since the start, whatever the motion",
        ("viscous", "viscous_asymmetry", "temperature_viscosity"),
        "the same motion with cold and with warm oil, and a record of the oil temperature",
        law_of="temperature_viscosity",
        follows=("time", "velocity"),
    )
    shapes = {"warming": Shape(20.0, 7200.0, "s", 7, "time constant with which the oil warms up")}
    symbol = Parameter("f_w", "{force} s/{coordinate}", 0.0, "viscous friction lost on warming")

    warming: float = Field(gt=0)
    since: float = 0.0

    def column(self, record: Record, j: int) -> Array:
        return record.velocity[:, j] * np.exp((self.since - record.time) / self.warming)


# Friction that follows the load: on pins, seals and the telescope's pads.


class LoadFriction(JointTerm):
    """mu |tau| sgn(q'): friction of pins and bearings in proportion to the load they carry.

    The load is taken to be the measured generalized force.
    """

    type: Literal["load_friction"] = "load_friction"
    family = "friction"
    effect = Effect(
        "load-dependent joint friction",
        "friction grows with the load, in both directions",
        ("coulomb", "seal_friction", "pad_friction", "position_friction"),
        "the same motion with raised back-pressure, and again with a known weight",
        kin=("weight_friction",),
        follows=("force",),
    )
    symbol = Parameter("mu_load", "1", 0.0, "friction per load")

    def column(self, record: Record, j: int) -> Array:
        return record.direction[:, j] * np.abs(self.needed(record, "force")[:, j])


class WeightFriction(OfBodies):
    """mu |g(q)| sgn(q'): friction of pins and bearings in proportion to the weight they carry.

    g is (7) of the `bodies` at rest. The measured force, the load of `LoadFriction`, holds friction
    itself and what accelerates the joint.
    """

    type: Literal["weight_friction"] = "weight_friction"
    family = "friction"
    effect = Effect(
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

    def joint_parameters(self, setting: Setting) -> tuple[Parameter, ...]:
        planar_machine(self, setting)
        return (Parameter("mu_weight", "1", 0.0, "friction per weight"),)

    def joint_columns(self, record: Record, setting: Setting, j: int) -> Array:
        still = np.zeros_like(record.velocity)
        rest = replace(record, velocity=still, acceleration=still)
        weight = self.force_of_bodies(rest, setting)[:, j]
        return record.direction[:, j] * np.abs(weight)


class SealFriction(OneJointTerm):
    """(mu_A A_A p_A + mu_B A_B p_B) |dx/dq| sgn(q'): pressure presses the seals on the bore.

    With A_A, A_B, p_A, p_B of (19) and the lever arm of (18); without a machine, all three are 1.
    """

    type: Literal["seal_friction"] = "seal_friction"
    family = "friction"
    effect = Effect(
        "pressure-dependent seal friction",
        "friction follows the sum of the chamber pressures, not their difference",
        ("load_friction", "weight_friction", "chamber_gain", "position_friction"),
        "the same motion with raised back-pressure",
        follows=("pressure sum",),
    )

    def joint_parameters(self, setting: Setting) -> tuple[Parameter, ...]:
        unit = gain_unit(setting, self.joint)
        return (
            Parameter("mu_A", unit, 0.0, "seal friction per pressure force of chamber A"),
            Parameter("mu_B", unit, 0.0, "seal friction per pressure force of chamber B"),
        )

    def joint_columns(self, record: Record, setting: Setting, j: int) -> Array:
        forces = np.abs(chamber_forces(self, record, setting, self.joint))
        return record.direction[:, j, np.newaxis] * forces


class PadFriction(OneJointTerm):
    """g |cos psi| (m_0 + m_1 q4) sgn(q4'): the telescope slides on pads that carry its weight.

    psi = q2 + q3 is its inclination. With the extension its overhang grows and pads press harder:
    linear in q4, which no drawing of the pads is needed for.
    """

    type: Literal["pad_friction"] = "pad_friction"
    family = "friction"
    effect = Effect(
        "telescope pad friction",
        "friction of the telescope falls with its inclination and grows with its extension",
        ("load_friction", "weight_friction", "position_friction"),
        "sweeps of the telescope at several inclinations of the outer boom",
        follows=("inclination of the telescope", "position"),
    )

    def joint_parameters(self, setting: Setting) -> tuple[Parameter, ...]:
        on_pads(self, setting)
        return (
            Parameter("pad_0", "kg", 0.0, "friction coefficient times load of the pads at q4 = 0"),
            Parameter("pad_1", "kg/m", 0.0, "the same for each metre of extension"),
        )

    def joint_columns(self, record: Record, setting: Setting, j: int) -> Array:
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
