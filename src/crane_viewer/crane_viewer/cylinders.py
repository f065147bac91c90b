"""Cylinders and links as round bars, from the machine file: lengths, pistons and rods are true."""

import math
from typing import NamedTuple

import numpy as np

from crane_model.actuators import CylinderActuator
from crane_model.inspection.placed import PlacedBar, placed_bars
from crane_model.machine import Machine

BARREL = (38, 42, 48)
ROD = (206, 212, 219)
LINK = (104, 112, 122)
WALL = 1.3  # of a barrel: radius outside over that of the piston
BARREL_SHARE = 0.92  # of the shortest length from pin to pin that the barrel takes
LINK_SHARE = 0.04  # of its length: radius of a link


class RoundBar(NamedTuple):
    """A straight round bar in the base's frame [m]."""

    begin: np.ndarray
    end: np.ndarray
    radius: float
    colour: tuple[int, int, int]


def round_bars(machine: Machine, q: np.ndarray) -> list[RoundBar]:
    """Barrels, rods and links at q (j,), always as many and in the same order."""
    return [part for bar in placed_bars(machine, q) for part in _parts(machine, bar)]


def _parts(machine: Machine, bar: PlacedBar) -> list[RoundBar]:
    length = float(np.linalg.norm(bar.end - bar.begin))
    actuator = machine.actuators[bar.joint]
    if not (bar.is_cylinder and isinstance(actuator, CylinderActuator)):
        return [RoundBar(bar.begin, bar.end, LINK_SHARE * length, LINK)]
    piston = math.sqrt(actuator.area_a_of_one / math.pi)
    rod = math.sqrt(max(actuator.area_a_of_one - actuator.area_b_of_one, 0.0) / math.pi)
    share = min(BARREL_SHARE * actuator.length_min / length, 1.0)
    mouth = bar.begin + share * (bar.end - bar.begin)
    return [
        RoundBar(bar.begin, mouth, WALL * piston, BARREL),
        RoundBar(bar.begin, bar.end, rod or 0.5 * piston, ROD),
    ]


def along_z(begin: np.ndarray, end: np.ndarray) -> tuple[float, float, float, float]:
    """Quaternion (x, y, z, w) that turns the z axis to the direction from `begin` to `end`."""
    x, y, z = (end - begin) / np.linalg.norm(end - begin)
    if z < -1.0 + 1e-12:
        return 1.0, 0.0, 0.0, 0.0
    w = math.sqrt((1.0 + z) / 2.0)
    return -y / (2.0 * w), x / (2.0 * w), 0.0, w
