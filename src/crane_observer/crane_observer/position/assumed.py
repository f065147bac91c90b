"""Valves that nobody identified: taken as plausible, and doubted as far as valves differ.

A spool command says which way a joint moves, and roughly how fast; where it is, its weight must
tell. With its encoder, or by its weight, the valve is learnt while the crane works.
"""

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from crane_model.array import Flags
from crane_model.cylinders import lever_arm
from crane_model.errors import ConfigurationError
from crane_model.hydraulics.values import (
    ChamberValues,
    HydraulicValues,
    JointHydraulics,
    Measured,
    ValveValues,
)
from crane_model.machine import Machine
from crane_model.model_file import Model

MOST_BY_WEIGHT = 1  # joints without encoder, which the weight of all tells apart
OVERSIZED = 3.0  # times the fastest that a joint may move, what a valve lets it at full opening
GAIN_DOUBT = 0.8  # of the flow, one standard deviation
GAIN_STAYS = 3.0  # s: at other openings it is another one
LOAD_DRIFT = 5.0  # kg/sqrt(s)
NULL_DOUBT = 0.03  # of the stroke
STROKE_DOUBT = 0.1  # of the stroke of a window, beside these
DEAD_ZONE = 0.05  # of the stroke
LAG = 0.05  # s
FREQUENCY = 60.0  # rad/s
DAMPING = 1.0
BULK_MODULUS = 1.2e9  # Pa
DEAD_VOLUME = 0.05  # of what a piston sweeps


class Served(NamedTuple):
    """A model whose valves are all known or assumed."""

    model: Model
    assumed: Flags  # (j,) whose valve is not identified

    @classmethod
    def of(cls, model: Model) -> "Served":
        """`ConfigurationError` where it has no machine, or where chambers of a joint have no
        pressure transducers.
        """
        if model.machine is None:
            raise ConfigurationError(
                f"model '{model.name}' names no machine file, which has levers and areas of its "
                "cylinders; identify it with one"
            )
        known = model.hydraulics or HydraulicValues(provenance="assumed", joints={})
        joints, assumed = dict(known.joints), np.zeros(len(model.joints), dtype=bool)
        for j, joint in enumerate(model.joints):
            values = joints.get(joint)
            if values is None or values.chambers is None:
                assumed[j], joints[joint] = True, _plausible(model.machine, joint)
        return cls(replace(model, hydraulics=known.model_copy(update={"joints": joints})), assumed)


def _plausible(machine: Machine, joint: str) -> JointHydraulics:
    limits, cylinder = machine.limits[joint], machine.cylinders.get(joint)
    if cylinder is None or not cylinder.pressure_sensors:
        raise ConfigurationError(
            f"{joint}: it has no chambers with pressure transducers (pressure_sensors in the "
            "machine file), by which its weight could tell where it is; leave it out of the model"
        )
    q = np.linspace(limits.position_min, limits.position_max, 21)
    lever = float(np.median(np.abs(lever_arm(machine, joint, q))))
    fastest = OVERSIZED * lever * min(-limits.velocity_min, limits.velocity_max)
    area = (cylinder.area_a + cylinder.area_b) / 2.0
    gain = fastest * area / np.sqrt(machine.hydraulics.supply_pressure / 2.0)
    swept = cylinder.chambers.empty_b - cylinder.chambers.empty_a
    values = {
        "dead_zone_a": DEAD_ZONE, "dead_zone_b": DEAD_ZONE, "hysteresis": 0.0, "lag": LAG,
        "natural_frequency": FREQUENCY, "damping_ratio": DAMPING, "supply_a": gain, "a_tank": gain,
        "supply_b": gain, "b_tank": gain, "bulk_modulus": BULK_MODULUS, "leakage": 0.0,
        "dead_volume_a": DEAD_VOLUME * swept * cylinder.chambers.growth_a,
        "dead_volume_b": DEAD_VOLUME * swept * cylinder.chambers.growth_b,
    }  # fmt: skip

    def part(kind: type[ValveValues] | type[ChamberValues]) -> dict[str, Measured]:
        return {name: Measured(value=values[name], unit=unit) for name, unit in kind.units.items()}

    return JointHydraulics(
        valve=ValveValues(**part(ValveValues)),
        chambers=ChamberValues(**part(ChamberValues)),
        unexplained=GAIN_DOUBT,
    )
