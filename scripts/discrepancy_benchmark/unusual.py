"""How far a hidden effect on the flow of oil leaves what a machine's data sheet calls usual.

Such effects do not show in the force. Every machine has leakage and soft oil, so that a little more
of them is no discrepancy: no recording tells it from another machine of the same make.
"""

from collections.abc import Callable
from typing import Any

import numpy as np

from crane_identification.discrepancy.hydraulics import Usual
from crane_model.record import Record
from crane_sim.hidden.flow import LAMINAR
from crane_sim.parameters import StandIn


def beyond_usual(
    effect: dict[str, Any], stand_in: StandIn, record: Record, usual: Usual
) -> float | None:
    """Share of the quantity's value that lies beyond the limit; 0 of a usual one.

    `effect` is an entry of a label, `record` what was recorded without noise. None where the data
    sheet has no such quantity.
    """
    judged = QUANTITIES.get(effect["name"])
    if judged is None:
        return None
    values = {one["name"]: one["value"] for one in effect["parameters"]}
    value, limit = judged(values, effect["joint"], stand_in, record, usual)
    return max(0.0, 1.0 - limit / value)


Values = dict[str, float]
Judged = tuple[float, float]
"""The value of a quantity of the machine, and the limit of what is usual."""


def _dead_zone(v: Values, joint: str, machine: StandIn, _: Record, usual: Usual) -> Judged:
    own = machine.valves[joint].dead_zone
    return own + (1.0 - own) * v["band"], usual.dead_zone[joint]


def _hysteresis(v: Values, _: str, _machine: StandIn, _record: Record, usual: Usual) -> Judged:
    return v["width"], usual.hysteresis


def _asymmetry(v: Values, _: str, _machine: StandIn, _record: Record, usual: Usual) -> Judged:
    return abs(v["share"]), usual.asymmetry


def _leakage(v: Values, joint: str, machine: StandIn, record: Record, usual: Usual) -> Judged:
    p_a, p_b = _pressures(joint, record)
    orifice = v["conductance"] / np.sqrt(np.hypot(p_a - p_b, LAMINAR))
    return machine.cylinders[joint].leakage + float(orifice.mean()), usual.leakage


def _softness(v: Values, joint: str, machine: StandIn, record: Record, usual: Usual) -> Judged:
    pressure = np.maximum(np.stack(_pressures(joint, record)), 0.0)
    softer = 1.0 + float((v["softness"] / (1.0 + pressure / v["stiffening"])).mean())
    return softer / machine.oil.bulk_modulus, 1.0 / usual.bulk_modulus


QUANTITIES: dict[str, Callable[[Values, str, StandIn, Record, Usual], Judged]] = {
    "valve_dead_zone": _dead_zone,
    "valve_hysteresis": _hysteresis,
    "valve_asymmetry": _asymmetry,
    "internal_leakage": _leakage,
    "oil_compressibility": _softness,
}


def _pressures(joint: str, record: Record) -> tuple[np.ndarray, np.ndarray]:
    """(n,) of chambers A and B [Pa]."""
    assert record.pressure_a is not None and record.pressure_b is not None  # clean recordings
    column = record.column(joint)
    return record.pressure_a[:, column], record.pressure_b[:, column]
