"""What the filter is given and what it tells, a window of time at once; j joints."""

from typing import NamedTuple

import numpy as np

from crane_model.array import Array


class FlowWindow(NamedTuple):
    """What was measured in it."""

    time: float  # s, at its end
    duration: float  # s
    sums: Array  # (j, SUMS) of `crane_observer.position.flow`
    before: Array  # (2, j) Pa in chambers A and B as it began
    after: Array  # (2, j) Pa as it ended
    encoders: Array  # (j,) rad or m at its end; NaN where there is none
    blind: Array  # (j,) s of it in which what flowed is not known
    whole: bool  # pressures were measured all the time


class PoseEstimate(NamedTuple):
    """What is known after it."""

    time: float  # s
    position: Array  # (j,)
    covariance: Array  # (j + 1, j + 1) of positions and load
    load: float  # kg
    velocity: Array  # (j,) mean over the window
    surprised: bool  # a load came or went in this window

    @property
    def deviation(self) -> Array:
        """(j + 1,) standard deviations of positions and load."""
        return np.sqrt(np.diag(self.covariance))
