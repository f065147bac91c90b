"""The four cylinders in the crane: lengths and lever arms at a pose, and the ends of their strokes.

The linkages are those of `crane_model.linkages`: geometry is known to both sides.
"""

from typing import NamedTuple

import numpy as np
from numba import njit

from crane_model.linkages import inner_boom, outer_boom


class Linkages(NamedTuple):
    """The constants of (20)-(26) and of the slew rack [m, rad]."""

    rack_radius: float
    j1: float
    j2: float
    angle_0: float
    gamma_21_0: float
    gamma_32: float
    s22: float
    s23: float
    c1: float
    c2: float
    s31: float


CYLINDER = (
    "area_a",
    "area_b",
    "length_min",
    "length_max",
    "dead_volume_a",
    "dead_volume_b",
    "leakage",
    "stop_stiffness",
    "stop_damping",
)
"""Fields of a cylinder's record: m2, m, m3 with hose, m3/s/Pa past the piston, N/m, s/m."""


@njit(cache=True, error_model="numpy")
def set_lengths_and_levers(linkages: Linkages, q: np.ndarray, actuators: np.ndarray) -> None:
    """Cylinder lengths x(q) [m] and lever arms dx/dq at the pose q (4,), into records (4,)."""
    slew, inner, outer, telescope = actuators[0], actuators[1], actuators[2], actuators[3]
    slew.length, slew.lever = linkages.rack_radius * q[0], linkages.rack_radius
    inner.length, inner.lever, _ = inner_boom(q[1], linkages.j1, linkages.j2, linkages.angle_0)
    outer.length, outer.lever, _ = outer_boom(
        q[2],
        linkages.gamma_21_0,
        linkages.gamma_32,
        linkages.s22,
        linkages.s23,
        linkages.c1,
        linkages.c2,
        linkages.s31,
    )
    telescope.length, telescope.lever = q[3], 1.0


@njit(cache=True, error_model="numpy")
def stop_force(cylinder: np.record, length: float, rate: float) -> float:
    """Force of the end stops on the piston [N], positive extending (Hunt and Crossley).

    Stiffness times depth, damped in proportion to the depth: no jump at the touch, never a pull.
    """
    if length < cylinder.length_min:
        depth, closing, sign = cylinder.length_min - length, -rate, 1.0
    elif length > cylinder.length_max:
        depth, closing, sign = length - cylinder.length_max, rate, -1.0
    else:
        return 0.0
    damped = max(1.0 + cylinder.stop_damping * closing, 0.0)
    return sign * cylinder.stop_stiffness * depth * damped
