"""Cylinder lengths and lever arms of a machine as tables, for compiled loops."""

import numpy as np
from numba import njit

from crane_model.machine import Machine

KNOTS = 513  # cubic between knots: errors below 1e-9 m over the ranges of Table 2


def tables(machine: Machine) -> np.ndarray:
    """(j, KNOTS, 4): q, length x [m], dx/dq, d2x/dq2 of each joint over its range."""
    rows = []
    for joint in machine.joint_names:
        limits = machine.limits[joint]
        q = np.linspace(limits.position_min, limits.position_max, KNOTS)
        rows.append(np.column_stack([q, machine.cylinder(joint, q)]))
    return np.array(rows)


@njit(cache=True, error_model="numpy")
def length_and_lever(table: np.ndarray, q: float) -> tuple[float, float]:
    """x [m] and dx/dq at q, from the rows (KNOTS, 4) of a joint; beyond them on a straight line."""
    step = table[1, 0] - table[0, 0]
    place = (q - table[0, 0]) / step
    if not 0.0 <= place <= len(table) - 1.0:
        end = 0 if place < 0.0 else len(table) - 1
        return table[end, 1] + table[end, 2] * (q - table[end, 0]), table[end, 2]
    k = min(int(place), len(table) - 2)
    s = place - k
    return (
        _hermite(s, table[k, 1], step * table[k, 2], table[k + 1, 1], step * table[k + 1, 2]),
        _hermite(s, table[k, 2], step * table[k, 3], table[k + 1, 2], step * table[k + 1, 3]),
    )


@njit(cache=True, error_model="numpy")
def _hermite(s: float, y0: float, d0: float, y1: float, d1: float) -> float:
    """The cubic on 0..1 with values y and slopes d at its ends."""
    rise = y1 - y0
    return y0 + s * (d0 + s * (3.0 * rise - 2.0 * d0 - d1 + s * (d0 + d1 - 2.0 * rise)))
