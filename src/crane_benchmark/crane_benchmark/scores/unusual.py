"""How far a hidden effect on the flow of oil leaves what a machine's data sheet calls usual.

Such effects do not show in the force. Every machine has leakage and soft oil, so that a little more
of them is no discrepancy: no recording tells it from another machine of the same make.
"""

import numpy as np

from crane_identification.diagnosis.flow.usual import Usual
from crane_model.flow.valve import EDGES, asymmetry
from crane_model.record import Record
from crane_sim.effects.flow import LAMINAR
from crane_sim.hiding.label import LabelledEffect
from crane_sim.parts.parameters import StandIn


def beyond_usual(
    effect: LabelledEffect, stand_in: StandIn, record: Record, usual: Usual
) -> float | None:
    """Share of the quantity's value that lies beyond the limit; 0 of a usual one.

    `record` is what was recorded without noise. None where the data
    sheet has no such quantity.
    """
    joint, given = effect.joint, {one.name: one.value for one in effect.parameters}
    if joint is None:
        return None
    p_a, p_b = _pressures(joint, record)
    valve = stand_in.valves[joint]
    match effect.name:
        case "valve_dead_zone":
            own = valve.dead_zone
            value = own + abs(valve.null_bias) + (1.0 - own) * given["band"]
            limit = usual.dead_zone[joint]
        case "valve_hysteresis":
            value, limit = given["width"], usual.hysteresis
        case "valve_asymmetry":
            more, less = 1.0 + given["share"], 1.0 - given["share"]
            gains = [getattr(valve.edges, edge) for edge in EDGES]
            value = abs(asymmetry(np.array(gains) * (more, less, less, more)))
            limit = usual.asymmetry
        case "internal_leakage":
            orifice = given["conductance"] / np.sqrt(np.hypot(p_a - p_b, LAMINAR))
            value = stand_in.cylinders[joint].leakage + float(orifice.mean())
            limit = usual.leakage_of(joint)
        case "oil_compressibility":
            ratio = np.maximum(np.stack([p_a, p_b]), 0.0) / given["stiffening"]
            softer = 1.0 + float((given["softness"] / (1.0 + ratio)).mean())
            value, limit = softer / stand_in.oil.bulk_modulus, 1.0 / usual.bulk_modulus
        case _:
            return None
    return 0.0 if value <= limit else 1.0 - limit / value


def _pressures(joint: str, record: Record) -> tuple[np.ndarray, np.ndarray]:
    """(n,) of chambers A and B [Pa]."""
    assert record.pressure_a is not None and record.pressure_b is not None  # clean recordings
    column = record.column(joint)
    return record.pressure_a[:, column], record.pressure_b[:, column]
