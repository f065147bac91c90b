"""What a piston tells of an open edge with next to no drop: how far off its transducers are.

The flow over it is hardly known, but grows with the root r of the drop. So the way that the piston
went asks for a drop d_E, by W r(d_E), where W r(d) is what it goes by a drop of d. If that is
further from the drop that is shown than zeros and noise are, a transducer lies.
"""

import numpy as np

from crane_model.array import Array, Flags
from crane_model.hydraulics.chambers import TRANSITION, roots
from crane_observer.position.flow import FAINT

OFF = 1e5  # Pa, by which zeros and noise of two transducers may be off


def slopes_of_liars(
    missed: Array, wide: Array, from_supply: Flags, drop: Array
) -> tuple[Array, Flags]:
    """How far pistons go for 1 Pa that a chamber shows too much, in the mean over the error by
    which it lies [m/Pa], and where it lies over next to no `drop` [Pa]; all of one shape.

    They went `missed` [m] further than by these drops; `wide` is W [m/Pa^0.5], 0 of an edge that
    was shut.
    """
    error = error_of_drop(missed, wide, drop) * np.where(from_supply, -1.0, 1.0)
    lies = (drop < FAINT) & (np.abs(error) > OFF)
    return np.divide(missed, error, out=np.zeros_like(missed), where=lies), lies


def error_of_drop(missed: Array, wide: Array, drop: Array) -> Array:
    """d - d_E [Pa], NaN of an edge that was shut; see `slopes_of_liars`."""
    asked = roots(drop) + missed / np.where(wide == 0.0, np.nan, wide)
    fourth = asked**4
    square = 0.5 * (fourth + np.sqrt(fourth**2 + 4.0 * fourth * TRANSITION**2))
    return np.asarray(drop - np.copysign(np.sqrt(square), asked))
