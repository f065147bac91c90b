"""What terms of the whole planar crane share: the check of the setting, and the tip's motion."""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from crane_model.array import Array
from crane_model.errors import ConfigurationError
from crane_model.machine import JOINT_UNITS, PLANAR_JOINTS, Machine
from crane_model.record import Record
from crane_model.terms.term import Setting, Term

_NEEDED = {joint: JOINT_UNITS[joint] for joint in PLANAR_JOINTS}


def planar_machine(term: Term, setting: Setting) -> Machine:
    """The machine; `ConfigurationError` unless the model has one and its planar joints."""
    if setting.machine is None or not holds_plane(setting):
        raise ConfigurationError(
            f"term '{term.type}': needs a machine and the joints {_listed(_NEEDED)}, "
            f"got {_listed(setting.units)}" + ("" if setting.machine else " and no machine")
        )
    return setting.machine


def holds_plane(setting: Setting) -> bool:
    """Whether a model has a machine and its planar joints."""
    return setting.machine is not None and _NEEDED.items() <= setting.units.items()


def planar_columns(record: Record) -> list[int]:
    """Where inner boom, outer boom and telescope stand among the joints of the record."""
    return [record.column(joint) for joint in PLANAR_JOINTS]


def _listed(units: Mapping[str, str]) -> str:
    return ", ".join(f"{joint} [{unit}]" for joint, unit in units.items())


class BoomDirections(NamedTuple):
    """phi of the inner boom, psi of the telescope's axis [rad] and q4 [m], (n,) each."""

    phi: Array
    psi: Array
    extension: Array

    @classmethod
    def of(cls, machine: Machine, record: Record) -> "BoomDirections":
        """At each sample."""
        q2, q3, q4 = record.position.T[planar_columns(record)]
        return cls(q2 + machine.denavit_hartenberg.theta_2_0, q2 + q3, q4)


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
        dh = machine.denavit_hartenberg
        phi, psi, extension = BoomDirections.of(machine, record)
        boom, along = dh.inner_boom_length * np.cos(phi), length + extension
        outer = along * np.cos(psi) - dh.telescope_offset * np.sin(psi)
        by_phi = -dh.inner_boom_length * np.sin(phi)
        by_psi = -along * np.sin(psi) - dh.telescope_offset * np.cos(psi)
        v2, v3, v4 = record.velocity.T[planar_columns(record)]
        turn = v2 + v3
        return cls(
            boom + outer,
            np.stack([by_phi + by_psi, by_psi, np.cos(psi)], axis=1),
            -boom * v2**2 - outer * turn**2 - 2.0 * np.sin(psi) * turn * v4,
        )
