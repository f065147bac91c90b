"""Cylinders as terms see them: lever arm, and the force of each chamber."""

import numpy as np

from crane_model.array import Array
from crane_model.cylinders import cylinder_geometry
from crane_model.errors import ConfigurationError
from crane_model.machine import Machine
from crane_model.record import Record
from crane_model.terms.term import Setting, Term


def cylinder_machine(term: Term, setting: Setting, joint: str) -> Machine:
    """The machine; `ConfigurationError` unless the model has one with a cylinder at `joint`."""
    machine = setting.machine
    if machine is None or joint not in machine.cylinders:
        raise ConfigurationError(
            f"term '{term.type}': needs a machine with a cylinder at joint '{joint}'; "
            + ("the model has no machine" if machine is None else f"it has {_listed(machine)}")
        )
    return machine


def lever(setting: Setting, joint: str, record: Record) -> Array:
    """dx/dq of (18), (n,); 1 where the model has no machine."""
    return lever_and_slope(setting, joint, record)[0]


def lever_and_slope(setting: Setting, joint: str, record: Record) -> tuple[Array, Array]:
    """dx/dq of (18) and d2x/dq2, (n,) each; 1 and 0 where the model has no machine."""
    q = record.position[:, record.column(joint)]
    if setting.machine is None:
        return np.ones_like(q), np.zeros_like(q)
    return cylinder_geometry(setting.machine, joint, q)[1:]


def chamber_forces(term: Term, record: Record, setting: Setting, joint: str) -> Array:
    """dx/dq A p of chambers A and B: (n, 2) generalized forces; areas are 1 without a machine."""
    j = record.column(joint)
    pressures = [term.needed(record, name)[:, j] for name in ("pressure_a", "pressure_b")]
    areas = (1.0, 1.0)
    if setting.machine is not None:
        cylinder = cylinder_machine(term, setting, joint).cylinders[joint]
        areas = cylinder.area_a, cylinder.area_b
    return lever(setting, joint, record)[:, np.newaxis] * np.stack(pressures, axis=1) * areas


def _listed(machine: Machine) -> str:
    return ", ".join(machine.cylinders) or "none"


def gain_unit(setting: Setting, joint: str) -> str:
    """Unit of a parameter that multiplies `chamber_forces`."""
    return "1" if setting.machine is not None else f"{setting.force_unit(joint)}/Pa"
