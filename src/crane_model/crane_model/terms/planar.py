"""What terms of the whole planar crane share: the check of the setting, and the tip's motion."""

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from crane_model.array import Array
from crane_model.errors import ConfigurationError
from crane_model.machine import Machine
from crane_model.record import Record
from crane_model.terms.term import Setting, Term


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
    """Where inner boom, outer boom and telescope stand among the joints of the record."""
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
        """At each sample."""
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
        """Of the point that lies `length` [m] from the elbow along the axis at q4 = 0."""
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
