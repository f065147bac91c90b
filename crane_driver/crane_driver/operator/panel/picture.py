"""What the page shows, as plain content for JSON: SI units, null for what is not known."""

import math
from collections.abc import Sequence
from typing import Any

from crane_driver.operator.wording import by_hand
from crane_model.machine import Machine

OLDEST_READING_S = 0.5  # what is older is not shown as if it were so now
SUPPLY, TANK = "supply", "tank"
BUTTONS = {
    "enable": "Enable",
    "disable": "Disable",
    "reset_fault": "Reset",
    "emergency_stop": "Stop",
}
"""What the page calls them, by the service of the driver."""

Content = dict[str, Any]


def plain(content: Any) -> Any:
    """`content` as the page can show it: null for each number that is not finite, and texts that
    name buttons where the driver names services.
    """
    if isinstance(content, dict):
        return {key: plain(value) for key, value in content.items()}
    if isinstance(content, list):
        return [plain(value) for value in content]
    if isinstance(content, float) and not math.isfinite(content):
        return None
    return by_hand(content, BUTTONS) if isinstance(content, str) else content


class ShownReadings:
    """The newest numbers of a topic by name, and when they came [s, steady clock]."""

    def __init__(self) -> None:
        self._values: dict[str, tuple[float, ...]] = {}
        self._came = -math.inf

    def take(self, names: Sequence[str], *columns: Sequence[float], now: float) -> None:
        """Columns of numbers (j,) that belong to `names`; what is shorter lacks the others."""
        rows = zip(*columns, strict=False)
        self._values = dict(zip(names, rows, strict=False))
        self._came = now

    def of(self, name: str, count: int, now: float) -> list[float | None]:
        """(count,) of a name: null where not finite, not there, or old."""
        values = self._values.get(name, ()) if now - self._came <= OLDEST_READING_S else ()
        if len(values) != count:
            return [None] * count
        numbers: list[float | None] = plain([float(value) for value in values])
        return numbers

    def strangers(self, known: Sequence[str]) -> list[str]:
        """Names that came and are not known."""
        return sorted(self._values.keys() - set(known))


def joints(machine: Machine, readings: ShownReadings, now: float) -> list[Content]:
    """Each joint against its limits (Table 2) [rad, m and per s]."""
    shown = []
    for joint, unit in machine.units.items():
        limits = machine.limits[joint]
        position, velocity = readings.of(joint, 2, now)
        shown.append(
            {
                "name": joint,
                "unit": unit,
                "position": position,
                "velocity": velocity,
                "lowest": limits.position_min,
                "highest": limits.position_max,
                "slowest": limits.velocity_min,
                "fastest": limits.velocity_max,
            }
        )
    return shown


def pressures(
    machine: Machine, chambers: ShownReadings, lines: ShownReadings, now: float
) -> Content | None:
    """Of each cylinder, and of the lines SUPPLY and TANK [Pa]; None where the machine has no oil.

    `highest` is that of the relief valve, the end of every scale.
    """
    if machine.supply is None:
        return None
    rows = [(one, chambers.of(one, 2, now)) for one in machine.cylinders]
    return {
        "highest": machine.supply.relief_pressure,
        "supply": lines.of(SUPPLY, 1, now)[0],
        "tank": lines.of(TANK, 1, now)[0],
        "cylinders": [{"name": name, "a": a, "b": b} for name, (a, b) in rows],
    }
