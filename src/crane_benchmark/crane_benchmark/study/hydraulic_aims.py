"""How well one bag of 60 s is to tell the hydraulics of a machine, and its motion from commands."""

from collections.abc import Mapping
from typing import NamedTuple


class Aim(NamedTuple):
    """What an error may be, of a made bag and of one recorded behind a bus; absolute in `unit`, or
    relative.
    """

    names: tuple[str, ...]
    made: float
    live: float
    unit: str = ""

    def told(self, value: float) -> str:
        """For a table."""
        return f"{value:.2g} {self.unit}" if self.unit else f"{100.0 * value:.2g} %"


AIMS = {
    "dead zones": Aim(("dead_zone_a", "dead_zone_b"), 0.001, 0.002),
    "flow gains": Aim(("supply_a", "a_tank", "supply_b", "b_tank"), 0.001, 0.001),
    "1/beta": Aim(("bulk_modulus",), 0.01, 0.02),
    "dead volumes": Aim(("dead_volume_a", "dead_volume_b"), 0.05, 0.08),
    "leakage": Aim(("leakage",), 0.15, 0.15),
    "lag": Aim(("lag",), 5e-4, 5e-4, "s"),
    "hysteresis": Aim(("hysteresis",), 3e-4, 3e-4, "of the stroke"),
}


AHEAD = {1.0: 0.002, 5.0: 0.001}
"""Error of motion from commands, by how far ahead [s], of the way."""


class Miss(NamedTuple):
    """An error, and the standard deviation that was told of the value [in the aim's unit]."""

    error: float
    std_dev: float


def worst(aim: Aim, found: Mapping[str, tuple[float, float]], planted: Mapping[str, float]) -> Miss:
    """The largest error of the values that the aim names, of all joints.

    `found` are values and standard deviations as NAME.JOINT, `planted` the true values.
    """
    misses = []
    for name, (value, std_dev) in found.items():
        if name.split(".", 1)[0] in aim.names:
            unit = 1.0 if aim.unit else abs(planted[name])
            misses.append(Miss(abs(value - planted[name]) / unit, std_dev / unit))
    return max(misses)
