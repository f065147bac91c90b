"""Friction of the other make: elasto-plastic bristles, the same in both directions of bending.

Dupont, Hayward, Armstrong and Altpeter, "Single state elastoplastic friction models", 2002:
bristles are elastic up to a share of their largest deflection, so that what stands does not creep.
"""

import math

from numba import njit

ELASTIC = 0.7  # of the largest deflection, up to which nothing slips


@njit(cache=True, error_model="numpy", forceinline=True)
def bent(z: float, v: float, largest: float, step: float) -> float:
    """Deflection [rad, m] after a step at velocity v, at most `largest` to either side."""
    slip = 0.0
    if z * v > 0.0 and abs(z) > ELASTIC * largest:
        phase = (abs(z) / largest - ELASTIC) / (1.0 - ELASTIC)
        slip = 1.0 if phase >= 1.0 else 0.5 - 0.5 * math.cos(math.pi * phase)
    z += step * v * (1.0 - slip * abs(z) / largest)
    return min(max(z, -largest), largest)
