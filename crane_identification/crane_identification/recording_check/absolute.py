"""Absolute for gauge pressures, from the ratio of the areas: needs no valve command.

The piston presses A_B/A_A as much oil out of chamber B as flows into chamber A. Through edges of
one size, (p_S - p_A)/(p_B - p_T) is the square of the ratio of the areas, which an offset of both
chambers spoils.
"""

from collections.abc import Iterator

import numpy as np

from crane_identification.recording_check.grid import Grid
from crane_identification.recording_check.suspicion import (
    FAST,
    FEWEST_STROKES,
    NEAR_ATMOSPHERE,
    Suspicion,
)
from crane_model.flow.oil import ATMOSPHERE

MEGA = 1e6


def absolute(whole: Grid) -> Iterator[Suspicion]:
    """One atmosphere too much in the chambers of nearly all cylinders and directions."""
    found = np.array(list(_offsets(whole)))
    alike = np.abs(found - ATMOSPHERE) < NEAR_ATMOSPHERE
    if alike.sum() >= FEWEST_STROKES:
        yield Suspicion(
            "pressures of all cylinders",
            f"flow in and out agree with the ratio of the areas if {found[alike].mean() / MEGA:.3f}"
            f" MPa are subtracted ({alike.sum()} of {len(found)} strokes)",
            "pressures look absolute, if the edges of the valves are of one size; gauge is needed",
            decisive=False,
        )


def _offsets(whole: Grid) -> Iterator[float]:
    """Offset [Pa] of both chambers of each cylinder, from its fast motion in each direction."""
    record = whole.record
    p_a, p_b = record.needed("pressure_a", "check"), record.needed("pressure_b", "check")
    supply = record.needed("supply_pressure", "check")
    tank = record.needed("tank_pressure", "check")
    speed = whole.arms * record.velocity
    for j, joint in enumerate(whole.joints):
        cylinder = whole.machine.cylinders[joint]
        for way, fed, drained, ratio in (
            (1.0, p_a[:, j], p_b[:, j], cylinder.area_a / cylinder.area_b),
            (-1.0, p_b[:, j], p_a[:, j], cylinder.area_b / cylinder.area_a),
        ):
            rows = whole.moving[:, j] & (way * speed[:, j] > FAST * np.abs(speed[:, j]).max())
            if rows.any():
                excess = ratio**2 * (drained - tank) - (supply - fed)
                yield float(np.median(excess[rows]) / (1.0 + ratio**2))
