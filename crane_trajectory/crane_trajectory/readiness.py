"""What is known of crane and driver, and what of it is in the way of an experiment."""

import math

import numpy as np

from crane_trajectory.experiment import at_rest
from crane_trajectory.tuning import Tuning

ENABLED = "enabled"  # the state of the driver in which commands reach the valves
RESTED = 0.2  # s without motion before an experiment
FORGET = 2.5  # s after which the driver's state is not known any more; it tells it every second


class Readiness:
    """Joint states and the driver's state as they come. Pure: it knows no ROS and reads no clock;
    `now` is of the steady clock [s].
    """

    def __init__(self) -> None:
        self.position: np.ndarray | None = None  # (4,) rad, m: the newest
        self.driver = "unknown"
        self._told = -math.inf  # when the driver told its state
        self._heard = -math.inf  # when the newest joint state came
        self._resting_since: float | None = None

    def forget_states(self) -> None:
        """As if no joint state had come."""
        self.position = self._resting_since = None

    def sample(
        self, position: np.ndarray, velocity: np.ndarray, tuning: Tuning, now: float
    ) -> None:
        """A joint state (4,), (4,) [SI] has come."""
        self.position, self._heard = position, now
        if not at_rest(velocity, tuning):
            self._resting_since = None
        elif self._resting_since is None:
            self._resting_since = now

    def driver_told(self, state: str, now: float) -> None:
        """The driver has told its state."""
        self.driver, self._told = state, now

    def lacking(self, states_timeout: float, now: float) -> str:
        """What is in the way of an experiment and what to do; empty if nothing is."""
        if self.position is None or now - self._heard > states_timeout:
            return "no joint states come; start the driver and see its /diagnostics"
        if self._resting_since is None or now - self._resting_since < RESTED:
            return "the crane is not at rest; bring it to rest"
        if now - self._told > FORGET:
            return "the driver does not tell its state; start it"
        if self.driver != ENABLED:
            return f"the driver is not enabled, its state is {self.driver}; call /driver/enable"
        return ""
