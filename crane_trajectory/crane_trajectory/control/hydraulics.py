"""What the controllers know of valves and oil: one record a joint, for compiled loops."""

from typing import NamedTuple

import numpy as np

from crane_model.errors import ConfigurationError


class Hydraulics(NamedTuple):
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
                bad |= (records[name] <= 0.0) if name not in SIGNED else False
            elif name not in SIGNED:
                bad |= records[name] < 0.0
            if bad.any():
                place = int(np.argmax(bad))
                raise ConfigurationError(
                    f"hydraulics: {name} of joint {place} is {records[name][place]:.6g}; "
                    "identify the hydraulics of this machine again"
                )
        return records


SIGNED = {"sense", "length_min", "length_max"}
MAY_BE_ZERO = SIGNED | {
    "dead_volume_a", "dead_volume_b", "leakage", "dead_zone_extend", "dead_zone_retract",
    "play", "lag", "tank_pressure",
}  # fmt: skip
