"""How well one bag of 60 s is to tell the hydraulics of a machine."""

from collections.abc import Mapping
from typing import Any, NamedTuple


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


class Miss(NamedTuple):
    """An error, and the standard deviation that was told of the value [in the aim's unit]."""

    error: float
    std_dev: float


def worst(aim: Aim, found: list[Mapping[str, Any]], planted: Mapping[str, float]) -> Miss:
    """The largest error of the values that the aim names, of all joints.

    `found` as `hydraulics` of a summary has them, `planted` by the same names, as NAME.JOINT.
    """
    misses = []
    for one in found:
        name = one["name"]
        if name.split(".", 1)[0] in aim.names and name in planted:
            unit = 1.0 if aim.unit else abs(planted[name])
            error = abs(one["value"] - planted[name]) / unit
            misses.append(Miss(error, one["std_dev"] / unit))
    return max(misses)
