"""`pd_dead_zone`: the controller (36) of the report behind the interface of all controllers."""

import math
from collections.abc import Mapping

import numpy as np

from crane_trajectory.control.controller import GainArrays, command
from crane_trajectory.control.cycle import BUMP, STOP_RATE
from crane_trajectory.control.interface import ControlCondition, SensorReading, Wanted

SATURATED, FOLLOWING, AT_REST = (
    ControlCondition.SATURATED,
    ControlCondition.FOLLOWING,
    ControlCondition.AT_REST,
)


class PdDeadZone:
    """(36): needs no model, no transducers and no preview."""

    preview = 0.0

    def __init__(self, gains: GainArrays, units: Mapping[str, str]):
        """`units` of the joints, as their machine has them."""
        self._gains, self._units = gains, units
        self._bump: np.ndarray | None = None  # None until the first command
        self._last = np.zeros(len(gains.kp))
        self.by_model = np.zeros(len(gains.kp), dtype=bool)
        self.conditions = (ControlCondition.NOT_INITIALISED,) * len(gains.kp)

    def start(self, command: np.ndarray) -> None:
        """Take over where `command` (j,) was in force, without a jump."""
        self._last, self._bump = np.array(command, dtype=float), None
        self.conditions = (AT_REST,) * len(self._last)

    def command(self, dt: float, reading: SensorReading, wanted: Wanted) -> np.ndarray:
        """As `Controller` has it."""
        now = wanted.now
        inputs = reading.position, reading.velocity, now.position, now.velocity
        if self._bump is None and not np.isfinite(reading.velocity).all():
            return self._last  # the velocity filter has only begun
        known = [bool(np.isfinite(one).all()) for one in np.transpose(inputs)]
        if not all(known) and not any(one.stops for one in self.conditions):
            self.conditions = tuple(
                AT_REST if one else ControlCondition.NOT_MEASURED for one in known
            )
        if any(one.stops for one in self.conditions):
            size = np.maximum(np.abs(self._last) - STOP_RATE * dt, 0.0)
            self._last = np.copysign(size, self._last)
            return self._last
        asked = command(self._gains, *inputs, units=self._units)
        if self._bump is None:
            self._bump = self._last - asked
        else:
            self._bump *= math.exp(-dt / BUMP)
        largest = wanted.largest
        self._last = np.clip(asked + self._bump, -largest, largest)
        moves = (now.velocity != 0.0) | (np.abs(asked) > self._gains.position_tolerance)
        self.conditions = tuple(
            SATURATED if abs(u) >= largest else FOLLOWING if moving else AT_REST
            for u, moving in zip(self._last, moves, strict=True)
        )
        return self._last
