"""A small pseudo-random command on top of a motion: what slow motion alone does not tell of valves.

How fast a valve is shows where its command changes faster than the crane moves. Half of the steps
open a valve a little more, the others a little less, at random but the same in all periods, so that
these still repeat.
"""

from functools import lru_cache
from typing import Annotated

import numpy as np
from pydantic import Field

from crane_model.configuration import Schema

LARGEST = 0.05  # [-1..1]: what no dead zone is narrower than, so that a valve at rest stays shut
SHORTEST_HOLD = 0.01  # s: two cycles of the controller


class Probe(Schema):
    """Commands of plus and minus `amplitude` [-1..1], held for `hold` [s] each."""

    amplitude: Annotated[float, Field(gt=0.0, le=LARGEST)]
    hold: Annotated[float, Field(ge=SHORTEST_HOLD, le=0.2)] = 0.015

    def course(self, time: np.ndarray, period: float, joints: int) -> np.ndarray:
        """(n, j) at time (n,) [s] of a trajectory of that period."""
        steps = _steps(max(int(period / self.hold), 1), joints)
        at = (np.mod(time, period) / self.hold).astype(int)
        return np.asarray(self.amplitude * steps[np.minimum(at, len(steps) - 1)])


@lru_cache
def _steps(count: int, joints: int) -> np.ndarray:
    """(count, j) of 1 and -1, different for each joint."""
    steps: np.ndarray = np.random.default_rng(joints).choice((-1.0, 1.0), (count, joints))
    return steps
