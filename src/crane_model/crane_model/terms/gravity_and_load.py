"""Forces on the whole crane: tilt of its base, payload, hoses, and slewing."""

from collections.abc import Iterable
from typing import Literal, NamedTuple

import numpy as np
from pydantic import Field, field_validator

from crane_model.array import Array
from crane_model.dynamics import Geometry, lagrangian_regressor
from crane_model.errors import ConfigurationError
from crane_model.machine import Machine
from crane_model.record import Record
from crane_model.terms.term import Effect, Load, Parameter, Setting, Shape, Term

# Common parts of terms of the whole planar crane: the check of the setting, and the tip's motion.


def planar_machine(term: Term, setting: Setting) -> Machine:
    """The machine; `ConfigurationError` unless it is planar and the model has its planar joints."""
    machine = setting.machine
    if machine is None:
        raise ConfigurationError(f"term '{term.type}': needs a machine, but the model has none")
    needed = machine.as_planar().joints
    if not plane_of(setting):
        raise ConfigurationError(
            f"term '{term.type}': needs the joints {_listed(machine, needed)}, "
            f"got {_listed(machine, setting.units)}"
        )
    return machine


def plane_of(setting: Setting) -> tuple[str, ...]:
    """Inner boom, outer boom and telescope, if the model has them all; else nothing."""
    if setting.machine is None or setting.machine.planar is None:
        return ()
    joints = setting.machine.planar.joints
    return joints if set(joints) <= setting.units.keys() else ()


def planar_columns(setting: Setting, record: Record) -> list[int]:
    """Columns of inner boom, outer boom and telescope among the joints of the record."""
    return [record.column(joint) for joint in plane_of(setting)]


def _listed(machine: Machine, joints: Iterable[str]) -> str:
    return ", ".join(f"{joint} [{machine.units[joint]}]" for joint in joints)


class BoomDirections(NamedTuple):
    """phi of the inner boom, psi of the telescope's axis [rad] and q4 [m], (n,) each."""

    phi: Array
    psi: Array
    extension: Array

    @classmethod
    def of(cls, machine: Machine, record: Record) -> "BoomDirections":
        crane = machine.as_planar()
        q2, q3, q4 = (record.position[:, record.column(joint)] for joint in crane.joints)
        return cls(q2 + crane.theta_2_0, q2 + q3, q4)


class AxisReach(NamedTuple):
    """How far a point on the telescope's axis is from the slew axis, and how that changes.

    x = a2 cos phi + (length + q4) cos psi - a3 sin psi.
    """

    distance: Array  # (n,) m
    gradient: Array  # (n, 3) dx/dq of inner boom, outer boom and telescope
    bias: Array  # (n,) m/s2: x'' - gradient q''

    @classmethod
    def of(cls, machine: Machine, length: float, record: Record) -> "AxisReach":
        """Motion of the point that lies `length` [m] from the elbow along the axis at q4 = 0."""
        dh = machine.as_planar()
        phi, psi, extension = BoomDirections.of(machine, record)
        cos_psi, sin_psi = np.cos(psi), np.sin(psi)
        boom, along = dh.inner_boom_length * np.cos(phi), length + extension
        outer = along * cos_psi - dh.telescope_offset * sin_psi
        by_phi = -dh.inner_boom_length * np.sin(phi)
        by_psi = -along * sin_psi - dh.telescope_offset * cos_psi
        v2, v3, v4 = (record.velocity[:, record.column(joint)] for joint in dh.joints)
        turn = v2 + v3
        return cls(
            boom + outer,
            np.stack([by_phi + by_psi, by_psi, cos_psi], axis=1),
            -boom * v2**2 - outer * turn**2 - 2.0 * sin_psi * turn * v4,
        )


class BaseTilt(Term):
    """alpha dG/dalpha: gravity (6) when the base is tilted by alpha in the plane of the booms.

    A tilt turns every mass moment about joint 2 and the elbow, which the base parameters (8) take
    up. What they cannot is the weight m of telescope and gripper along and across q4: with
    V = m g q4 sin(psi + alpha) the column is that of m alpha.
    """

    type: Literal["base_tilt"] = "base_tilt"
    family = "gravity and load"
    effect = Effect(
        "base tilt",
        "gravity from a turned direction on all joints, above all along the telescope",
        ("encoder_offset",),
        "an inclinometer on the base",
        follows=("inclination of the telescope",),
    )

    def parameters(self, setting: Setting) -> tuple[Parameter, ...]:
        planar_machine(self, setting)
        meaning = "mass of telescope and gripper times the angle by which the base is tilted"
        return (Parameter("m_tilt", "kg rad", None, meaning),)

    def fill(self, record: Record, setting: Setting, columns: Array) -> None:
        weight = turned_weight(planar_machine(self, setting), record)
        columns[:, planar_columns(setting, record), 0] = weight


def turned_weight(machine: Machine, record: Record) -> Array:
    """d/dalpha of the gravity of a mass of 1 kg at q4, V = g q4 sin(psi + alpha): (n, 3)."""
    _, psi, extension = BoomDirections.of(machine, record)
    turning = -machine.gravity * extension * np.sin(psi)
    return np.stack([turning, turning, machine.gravity * np.cos(psi)], axis=1)


class Payload(Term):
    """m_k J_tip^T (g + a): a point mass at the boom tip (2) in the runs of load k = 1, 2, ...

    Only differences between runs are determined: a mass in every run is the same as a heavier
    telescope. So masses count from that of the runs in no load, the lightest. Without `loads` it is
    one mass in every run. Numbers of runs hold for the records that they were given for; one
    without runs carries none of the loads.
    """

    type: Literal["payload"] = "payload"
    family = "gravity and load"
    effect = Effect(
        "payload change",
        "a fixed pattern over the joints that steps from one run to another",
        ("pressure_gain", "hose_mass"),
        "the same motion with an empty gripper and with a known weight",
        follows=("recording",),
    )
    carries_loads = True

    loads: tuple[Load, ...] | None = None

    @field_validator("loads")
    @classmethod
    def _apart(cls, loads: tuple[Load, ...] | None) -> tuple[Load, ...] | None:
        runs = [run for load in loads or () for run in load.runs]
        if twice := sorted({run for run in runs if runs.count(run) > 1}):
            raise ValueError(f"run {twice[0]} is in two loads; a run carries one")
        return loads

    @property
    def of_recordings(self) -> bool:
        return self.loads is not None

    @property
    def carried(self) -> tuple[Load, ...]:
        return self.loads or ()

    def parameters(self, setting: Setting) -> tuple[Parameter, ...]:
        planar_machine(self, setting)
        if self.loads is None:
            return (Parameter("m_payload", "kg", None, "payload beyond that of the model"),)
        return tuple(
            Parameter(f"m_payload_{k}", "kg", 0.0, f"load {k}, beyond what the other runs carry")
            for k in range(1, len(self.loads) + 1)
        )

    def fill(self, record: Record, setting: Setting, columns: Array) -> None:
        machine, at = planar_machine(self, setting), planar_columns(setting, record)
        motion = record.position[:, at], record.velocity[:, at], record.acceleration[:, at]
        column = lagrangian_regressor(Geometry.of(machine), *motion) @ tip_mass(machine)
        if self.loads is None:
            columns[:, at, 0] = column
            return
        if record.run is None:
            return
        for k, load in enumerate(self.loads):
            inside = np.isin(record.run, load.runs)
            columns[:, at, k] = np.where(inside[:, np.newaxis], column, 0.0)


def tip_mass(machine: Machine) -> Array:
    """(9,): the Lagrangian parameters of a mass of 1 kg at the boom tip."""
    dh = machine.as_planar()
    a2, a3, length = dh.inner_boom_length, dh.telescope_offset, dh.telescope_length
    return np.array([a2**2, a2, 0.0, length**2 + a3**2, length, a3, 1.0, length, a3])


class HoseMass(Term):
    """V = rho g q4^2/2 sin(psi): hoses of rho [kg/m] that come out with the telescope.

    Hoses paid out from a reel have rho > 0; a drag chain, which folds back, has rho < 0. Their
    inertia is left out: a few kilograms at accelerations far below g.
    """

    type: Literal["hose_mass"] = "hose_mass"
    family = "gravity and load"
    effect = Effect(
        "hose mass",
        "weight on booms and telescope that grows with the square of the extension",
        ("payload",),
        "poses at rest at several extensions and inclinations of the outer boom",
        follows=("extension of the telescope", "inclination of the telescope"),
    )

    def parameters(self, setting: Setting) -> tuple[Parameter, ...]:
        planar_machine(self, setting)
        return (Parameter("rho_hose", "kg/m", None, "mass of hoses that comes out per metre"),)

    def fill(self, record: Record, setting: Setting, columns: Array) -> None:
        machine = planar_machine(self, setting)
        _, psi, extension = BoomDirections.of(machine, record)
        turning = machine.gravity * extension**2 / 2.0 * np.cos(psi)
        inner, outer, telescope = planar_columns(setting, record)
        columns[:, inner, 0] = columns[:, outer, 0] = turning
        columns[:, telescope, 0] = machine.gravity * extension * np.sin(psi)


class SlewCoupling(Term):
    """-1/2 q1'^2 dI/dq: centrifugal force of booms with inertia I(q) about the slew axis.

    I = J cos^2(phi) + m x^2: a slender inner boom, and all else as a mass m that lies `reach` [m]
    from the elbow along the telescope at q4 = 0, at the distance x from the axis.
    """

    type: Literal["slew_coupling"] = "slew_coupling"
    family = "gravity and load"
    effect = Effect(
        "slew coupling",
        "force with the square of the slew velocity, only while slewing",
        (),
        "the same motion with and without slewing",
        follows=("slew velocity",),
    )
    shapes = {"reach": Shape(0.4, 1.8, "m", 4, "elbow to centre of the mass of the outer boom")}

    reach: float = Field(gt=0)

    def parameters(self, setting: Setting) -> tuple[Parameter, ...]:
        planar_machine(self, setting)
        return (
            Parameter("J_slew", "kg m2", 0.0, "inertia of the inner boom that slews"),
            Parameter("m_slew", "kg", 0.0, "mass of outer boom and telescope that slews"),
        )

    def fill(self, record: Record, setting: Setting, columns: Array) -> None:
        machine = planar_machine(self, setting)
        spin = self.needed(record, "slew_velocity") ** 2
        phi, _, _ = BoomDirections.of(machine, record)
        reach = AxisReach.of(machine, self.reach, record)
        at = planar_columns(setting, record)
        columns[:, at[0], 0] = spin * np.sin(phi) * np.cos(phi)
        columns[:, at, 1] = -(spin * reach.distance)[:, np.newaxis] * reach.gradient
