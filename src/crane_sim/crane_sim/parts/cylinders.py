"""The actuators in the machine: lengths and lever arms at a pose, and the ends of their strokes.

The linkages are those of `crane_model.linkages`: geometry is known to both sides.
"""

from typing import NamedTuple

import numpy as np
from numba import njit

from crane_model.linkages import motion


class Linkages(NamedTuple):
    """x(q) of the actuators of j joints, as `crane_model.linkages.motion` takes it."""

    kind: np.ndarray  # (j,) int
    begin: np.ndarray  # (j,) int: where in `constants` its own begin,
    end: np.ndarray  # (j,) int: and end
    constants: np.ndarray


CYLINDER = (
    "area_a",
    "area_b",
    "filled_a",
    "filled_b",
    "length_min",
    "length_max",
    "dead_volume_a",
    "dead_volume_b",
    "leakage",
    "stop_stiffness",
    "stop_damping",
)
"""Fields of a cylinder's record: m2, also of what its stroke fills (0 of a motor); m; m3 with hose;
m3/s/Pa past the piston; N/m; s/m. Of a motor m3/rad in the place of m2, rad in the place of m."""


@njit(cache=True, error_model="numpy")
def set_lengths_and_levers(linkages: Linkages, q: np.ndarray, actuators: np.ndarray) -> None:
    """Lengths x(q) [m], lever arms dx/dq and their slopes at the pose q (j,), into records (j,)."""
    for i in range(len(q)):
        actuator = actuators[i]
        constants = linkages.constants[linkages.begin[i] : linkages.end[i]]
        actuator.length, actuator.lever, actuator.slope = motion(linkages.kind[i], constants, q[i])


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
