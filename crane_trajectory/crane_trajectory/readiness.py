"""What is known of the crane, and what of it is in the way of an experiment."""

import math
from collections.abc import Mapping

import numpy as np

from crane_trajectory.control.tuning import Tuning
from crane_trajectory.experiment import at_rest

REST_TIME_S = 0.2  # without motion before an experiment


class Readiness:
    """Joint states as they come. Pure: it knows no ROS and reads no clock; `now` is of the steady
    clock [s].
    """

    def __init__(self) -> None:
        self.position: np.ndarray | None = None  # (j,) rad, m: the newest
        self._heard = -math.inf  # when the newest joint state came
        self._resting_since: float | None = None

    def forget_states(self) -> None:
        """As if no joint state had come."""
        self.position = self._resting_since = None

    def sample(
        self, position: np.ndarray, velocity: np.ndarray, tuning: Tuning, now: float
    ) -> None:
        """A joint state (j,), (j,) [SI] has come."""
        self.position, self._heard = position, now
        if not at_rest(velocity, tuning):
            self._resting_since = None
        elif self._resting_since is None:
            self._resting_since = now

    def lacking(self, states_timeout: float, now: float) -> str:
        """What is in the way of an experiment and what to do; empty if nothing is."""
        if self.position is None or now - self._heard > states_timeout:
            return "no joint states come; start the driver and see its /diagnostics"
        if self._resting_since is None or now - self._resting_since < REST_TIME_S:
            return "the crane is not at rest; bring it to rest"
        return ""

    def moved_from(self, start: np.ndarray, tuning: Tuning, units: Mapping[str, str]) -> str:
        """Names the joints, of `units`, that are no longer where a motion starts (j,) [SI], within
        half their tolerance; empty if there is none.
        """
        assert self.position is not None
        way, most = np.abs(self.position - start), tuning.tolerance / 2
        return "; ".join(
            f"{joint}: moved by {way[i]:.4g} {unit} while its motion was planned, half the "
            f"tolerance is {most[i]:.4g} {unit}"
            for i, (joint, unit) in enumerate(units.items())
            if way[i] > most[i]
        )
