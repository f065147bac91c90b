"""Units that tables may come in, and what turns their numbers into SI."""

import math
from typing import NamedTuple


class Unit(NamedTuple):
    """What a unit measures, and its size in SI units (temperature: degrees Celsius)."""

    quantity: str
    factor: float


COUNTS = "counts"
"""Unit and quantity of a sensor that was never calibrated: its numbers stay as they are."""

DATE = "ISO 8601"
"""Unit of times that are texts, with or without a date: 2026-05-04T09:30:00.25+02:00."""

UNITS = {
    "s": Unit("time", 1.0),
    "ms": Unit("time", 1e-3),
    "us": Unit("time", 1e-6),
    "ns": Unit("time", 1e-9),
    DATE: Unit("time", 1.0),
    "rad": Unit("angle", 1.0),
    "deg": Unit("angle", math.pi / 180),
    "m": Unit("length", 1.0),
    "cm": Unit("length", 1e-2),
    "mm": Unit("length", 1e-3),
    "rad/s": Unit("angular velocity", 1.0),
    "deg/s": Unit("angular velocity", math.pi / 180),
    "rpm": Unit("angular velocity", math.pi / 30),
    "m/s": Unit("linear velocity", 1.0),
    "mm/s": Unit("linear velocity", 1e-3),
    "rad/s2": Unit("angular acceleration", 1.0),
    "deg/s2": Unit("angular acceleration", math.pi / 180),
    "m/s2": Unit("linear acceleration", 1.0),
    "mm/s2": Unit("linear acceleration", 1e-3),
    "N": Unit("force", 1.0),
    "kN": Unit("force", 1e3),
    "N m": Unit("torque", 1.0),
    "kN m": Unit("torque", 1e3),
    "Pa": Unit("pressure", 1.0),
    "kPa": Unit("pressure", 1e3),
    "MPa": Unit("pressure", 1e6),
    "bar": Unit("pressure", 1e5),
    "psi": Unit("pressure", 6894.757293168),
    "deg C": Unit("temperature", 1.0),
    "-": Unit("command", 1.0),
    "%": Unit("command", 1e-2),
    COUNTS: Unit(COUNTS, 1.0),
}
