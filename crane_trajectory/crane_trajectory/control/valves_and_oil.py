"""What the controllers know of valves and oil: one record a joint, for compiled loops."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from crane_model.errors import ConfigurationError
from crane_model.hydraulics.values import HydraulicValues
from crane_model.machine import Machine

TURN = 2.0 * np.pi  # rad, of the shaft of a motor


class ValvesAndOil(NamedTuple):
    """Valves and oil of j joints, (j,) each [SI].

    The spool y, in the direction of extending, trails its command by `lag` and `play`. It opens
    beyond the dead zones; what it is beyond, o, is the opening. Each edge passes gain times o times
    the root of the pressure drop.
    """

    sense: np.ndarray  # +1 where extending moves the joint up, else -1
    area_a: np.ndarray  # m2
    area_b: np.ndarray
    length_min: np.ndarray  # m, where the piston of chamber A ends
    length_max: np.ndarray
    dead_volume_a: np.ndarray  # m3, with hose
    dead_volume_b: np.ndarray
    bulk_modulus: np.ndarray  # Pa
    leakage: np.ndarray  # m3/s/Pa past the piston
    supply_a: np.ndarray  # m3/s/sqrt(Pa) at an opening of 1: gains of the four edges
    a_tank: np.ndarray
    supply_b: np.ndarray
    b_tank: np.ndarray
    dead_zone_extend: np.ndarray  # of the command
    dead_zone_retract: np.ndarray
    play: np.ndarray  # width, of the command
    lag: np.ndarray  # s, from a reading to the spool's answer
    supply_pressure: np.ndarray  # Pa, where none is measured
    tank_pressure: np.ndarray

    def records(self) -> np.ndarray:
        """(j,) records with these fields; `ConfigurationError` where a value cannot be."""
        records = np.empty(len(self.sense), np.dtype([(name, float) for name in self._fields]))
        for name, column in zip(self._fields, self, strict=True):
            records[name] = column
            bad = ~np.isfinite(records[name])
            if name not in MAY_BE_ZERO:
                bad |= records[name] <= 0.0
            elif name not in SIGNED:
                bad |= records[name] < 0.0
            if bad.any():
                place = int(np.argmax(bad))
                raise ConfigurationError(
                    f"hydraulics: {name} of joint {place} is {records[name][place]:.6g}; "
                    "identify the hydraulics of this machine again"
                )
        return records


def identified(machine: Machine, values: HydraulicValues, joints: Sequence[str]) -> ValvesAndOil:
    """Of some joints, from what was identified of the machine.

    A joint without chamber values has the mean oil of those with some, and dead volumes of a
    twentieth of its chambers, or of what a turn of a motor takes in. `ConfigurationError` if no
    joint has any.
    """
    named = {
        joint: {name: value.value for name, value in values.joints[joint].values.items()}
        for joint in values.joints
    }
    oil = [one["bulk_modulus"] for one in named.values() if "bulk_modulus" in one]
    if not oil:
        raise ConfigurationError(
            f"{machine.name}: the bulk modulus of the oil is unknown; identify the hydraulics "
            "from a recording with chamber pressures"
        )
    supply = machine.hydraulics
    pressure = values.supply.pressure.value if values.supply else supply.supply_pressure
    rows = []
    for joint in joints:
        known, actuator, limits = named[joint], machine.cylinders[joint], machine.limits[joint]
        middle = np.array([(limits.position_min + limits.position_max) / 2.0])
        chambers = actuator.chambers
        way = chambers.empty_b - chambers.empty_a or TURN
        row = {
            "sense": float(np.sign(machine.cylinder(joint, middle)[0, 1])),
            "area_a": actuator.area_a,
            "area_b": actuator.area_b,
            "length_min": chambers.empty_a,
            "length_max": chambers.empty_b,
            "dead_volume_a": known.get("dead_volume_a", actuator.area_a * way / 20.0),
            "dead_volume_b": known.get("dead_volume_b", actuator.area_b * way / 20.0),
            "bulk_modulus": known.get("bulk_modulus", float(np.mean(oil))),
            "leakage": known.get("leakage", 0.0),
            **{edge: known[edge] for edge in ("supply_a", "a_tank", "supply_b", "b_tank")},
            "dead_zone_extend": known["dead_zone_a"],
            "dead_zone_retract": known["dead_zone_b"],
            "play": known["hysteresis"],
            "lag": known["lag"],
            "supply_pressure": pressure,
            "tank_pressure": supply.tank_pressure,
        }
        rows.append([row[name] for name in ValvesAndOil._fields])
    return ValvesAndOil(*np.array(rows).T)


SIGNED = {"sense", "length_min", "length_max"}
MAY_BE_ZERO = SIGNED | {
    "dead_volume_a", "dead_volume_b", "leakage", "dead_zone_extend", "dead_zone_retract",
    "play", "lag", "tank_pressure",
}  # fmt: skip
