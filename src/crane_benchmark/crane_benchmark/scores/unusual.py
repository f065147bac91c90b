"""How far a hidden effect on the flow of oil leaves what a machine's data sheet calls usual.

Such effects do not show in the force. Every machine has leakage and soft oil, so that a little more
of them is no discrepancy: no recording tells it from another machine of the same make.
"""

from collections.abc import Callable, Mapping

import numpy as np

from crane_benchmark.cases.joints import LABORATORY_CRANE
from crane_identification.diagnosis.flow.usual import Usual
from crane_model.flow.valve import EDGES, asymmetry
from crane_model.record import Record
from crane_sim.effects.flow import LAMINAR
from crane_sim.hiding.label import LabelledEffect
from crane_sim.parts.parameters import StandIn

WALLS: Mapping[str, Callable[[np.ndarray], np.ndarray]] = {
    "hose_wall": lambda ratio: 1.0 / (1.0 + ratio),
    "braid": lambda ratio: np.exp(-ratio),
    "long_hose": lambda ratio: 1.0 / np.sqrt(1.0 + ratio),
}
"""How much a wall still gives, by its law, at a pressure over that which stiffens it."""


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
            band = given["band"] * (1.0 + abs(given.get("lean", 0.0)))
            value = own + abs(valve.null_bias) + (1.0 - own) * band
            limit = usual.dead_zone[joint]
        case "valve_hysteresis":
            # of two plays the mean, of half the weight each
            value = given["width"] * (1.0 + given.get("inner", 1.0)) / 2.0
            limit = usual.hysteresis
        case "valve_asymmetry":
            more, less = 1.0 + given["share"], 1.0 - given["share"]
            if effect.form == "one_way":
                more, less = 1.0 + 2.0 * given["share"], 1.0
            gains = [getattr(valve.edges, edge) for edge in EDGES]
            value = abs(asymmetry(np.array(gains) * (more, less, less, more)))
            limit = usual.asymmetry
        case "internal_leakage":
            value = stand_in.cylinders[joint].leakage + _leak(effect.form, given, joint, record)
            limit = usual.leakage_of(joint)
        case "oil_compressibility":
            ratio = np.maximum(np.stack([p_a, p_b]), 0.0) / given["stiffening"]
            softer = 1.0 + float((given["softness"] * WALLS[effect.form](ratio)).mean())
            value, limit = softer / stand_in.oil.bulk_modulus, 1.0 / usual.bulk_modulus
        case _:
            return None
    return 0.0 if value <= limit else 1.0 - limit / value


def _leak(form: str, given: Mapping[str, float], joint: str, record: Record) -> float:
    """Its mean conductance [m3/(s Pa)]."""
    p_a, p_b = _pressures(joint, record)
    drop, size = np.abs(p_a - p_b), given["conductance"]
    if form == "orifice":
        return float((size / np.sqrt(np.hypot(drop, LAMINAR))).mean())
    if form == "widening":
        return size * (1.0 + float(drop.mean()) / given["widening"])
    limits = LABORATORY_CRANE.limits[joint]
    middle = (limits.position_max + limits.position_min) / 2.0
    half = (limits.position_max - limits.position_min) / 2.0
    place = (record.position[:, record.column(joint)] - middle) / half
    return size * (1.0 + given["middle"] * float(np.exp(-4.0 * place**2).mean()))


def _pressures(joint: str, record: Record) -> tuple[np.ndarray, np.ndarray]:
    """(n,) of chambers A and B [Pa]."""
    assert record.pressure_a is not None and record.pressure_b is not None  # clean recordings
    column = record.column(joint)
    return record.pressure_a[:, column], record.pressure_b[:, column]
