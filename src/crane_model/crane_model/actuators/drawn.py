"""What pictures show of an actuator: lines between pins, in the plane across the joint's axis.

x of the plane is that of the joint's frame, before it moves; the joint is at its origin.
"""

import math
from typing import NamedTuple

import numpy as np

from crane_model.array import Array


class Bar(NamedTuple):
    """A part between two pins (2,) [m]: a cylinder, or a link."""

    begin: Array
    end: Array
    is_cylinder: bool


def direction(angle: float) -> Array:
    """Unit vector (2,)."""
    return np.array([math.cos(angle), math.sin(angle)])


def meeting(one: Array, radius: float, other: Array, other_radius: float) -> Array:
    """Where two circles meet, to the right of the line between them; nan where they do not."""
    line = other - one
    distance = math.hypot(*line)
    along = (radius**2 - other_radius**2 + distance**2) / (2.0 * distance)
    square = radius**2 - along**2
    across = math.sqrt(square) if square >= 0.0 else math.nan
    unit = line / distance
    found: Array = one + along * unit + across * np.array([unit[1], -unit[0]])
    return found
