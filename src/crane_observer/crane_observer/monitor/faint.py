"""What a piston tells of an open edge with next to no drop: how far off its transducers are.

The flow over it is hardly known, but grows with the root r of the drop. So the way that the piston
went asks for a drop d_E, by W r(d_E), where W r(d) is what it goes by a drop of d.
"""

import numpy as np

from crane_model.array import Array
from crane_model.hydraulics.chambers import TRANSITION, roots


def error_of_drop(missed: Array, wide: Array, drop: Array) -> Array:
    """d - d_E [Pa] of drops d [Pa], of any shape, where pistons went `missed` [m] further than by
    them; `wide` is W [m/Pa^0.5], 0 of an edge that was shut, of which it is NaN.
    """
    asked = roots(drop) + missed / np.where(wide == 0.0, np.nan, wide)
    fourth = asked**4
    square = 0.5 * (fourth + np.sqrt(fourth**2 + 4.0 * fourth * TRANSITION**2))
    return np.asarray(drop - np.copysign(np.sqrt(square), asked))
