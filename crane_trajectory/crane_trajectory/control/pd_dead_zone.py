"""`pd_dead_zone`: the controller (36) of the report behind the interface of all controllers."""

import math

import numpy as np
from numba import njit

from crane_trajectory.control.controller import GainArrays, gains_of, joint_command
from crane_trajectory.control.cycle import BUMP, STOP_RATE
from crane_trajectory.control.interface import ControlCondition, SensorReading, Wanted, conditions

SATURATED, FOLLOWING = int(ControlCondition.SATURATED), int(ControlCondition.FOLLOWING)
AT_REST, NOT_MEASURED = int(ControlCondition.AT_REST), int(ControlCondition.NOT_MEASURED)
NOT_INITIALISED = int(ControlCondition.NOT_INITIALISED)  # the first that stops


class PdDeadZone:
    """(36): needs no model, no transducers and no preview."""

    preview = 0.0

    def __init__(self, gains: GainArrays):
        self._gains = gains
        self._begun = False  # a command has been given since `start`
        self._last, self._bump = np.zeros((2, len(gains.kp)))
        self._codes = np.full(len(gains.kp), NOT_INITIALISED)
        self.by_model = np.zeros(len(gains.kp), dtype=bool)

    def start(self, command: np.ndarray) -> None:
        """Take over where `command` (j,) was in force, without a jump."""
        self._last[:], self._begun = command, False
        self._codes[:] = AT_REST

    def command(self, dt: float, reading: SensorReading, wanted: Wanted) -> np.ndarray:
        """As `Controller` has it."""
        if self._begun or np.isfinite(reading.velocity).all():  # else the filter has only begun
            now = wanted.now
            inputs = np.array([reading.position, reading.velocity, now.position, now.velocity])
            self._begun = _cycle(
                *(self._gains, dt, inputs, wanted.largest, self._begun),
                *(self._last, self._bump, self._codes),
            )
        return self._last.copy()

    @property
    def conditions(self) -> tuple[ControlCondition, ...]:
        """Of each joint, after the last command."""
        return conditions(self._codes)


@njit(cache=True)
def _cycle(
    gains: GainArrays,
    dt: float,
    inputs: np.ndarray,
    largest: float,
    begun: bool,
    u: np.ndarray,
    bump: np.ndarray,
    codes: np.ndarray,
) -> bool:
    """Commands u (j,) that answer the inputs (4, j) of (36); whether one was given by (36)."""
    stop = False
    for code in codes:
        stop |= code >= NOT_INITIALISED
    if not stop and not np.isfinite(inputs).all():
        for i in range(len(u)):
            codes[i] = AT_REST if np.isfinite(inputs[:, i]).all() else NOT_MEASURED
        stop = True
    if stop:
        for i in range(len(u)):
            u[i] = math.copysign(max(abs(u[i]) - STOP_RATE * dt, 0.0), u[i])
        return begun
    for i in range(len(u)):
        one = gains_of(gains, i)
        q, velocity, q_ref, velocity_ref = inputs[0, i], inputs[1, i], inputs[2, i], inputs[3, i]
        asked = joint_command(one, q, velocity, q_ref, velocity_ref)
        bump[i] = bump[i] * math.exp(-dt / BUMP) if begun else u[i] - asked
        u[i] = min(max(asked + bump[i], -largest), largest)
        if abs(u[i]) >= largest:
            codes[i] = SATURATED
        else:
            moves = velocity_ref != 0.0 or abs(q_ref - q) > one.position_tolerance
            codes[i] = FOLLOWING if moves else AT_REST
    return True
