"""Table 2 kept: speed limited by the braking distance, and no motion into a limit."""

import math
from pathlib import Path
from typing import Annotated, Self

from pydantic import Field, model_validator

from crane_model.configuration import Positive, Schema, load
from crane_model.errors import ConfigurationError
from crane_model.joint_tables import of_every_joint
from crane_model.machine import JointLimits, Machine

# The settings of the safety functions, from `safety.yaml`.

Spool = Annotated[float, Field(gt=0, lt=1)]


class DegradedSettings(Schema):
    """When a joint may go on by an estimate in the place of its encoder."""

    speed: Annotated[float, Field(gt=0, le=1)]  # share of that of Table 2, of every joint
    timeout: Positive  # s
    deviation: dict[str, Positive]  # joint: rad, m; others have no substitute


class SafetySettings(Schema):
    """Times [s], spool commands -1 to 1, decelerations [SI]; meaning in the file."""

    command_timeout: Positive
    ramp_time: Positive
    neutral: Spool
    settling_time: Positive
    deceleration: dict[str, Positive]  # joint
    reaction_time: Positive
    correction_time: Positive
    opening: Spool
    opening_time: Positive
    jump_speed: Annotated[float, Field(ge=1)]
    still_time: Positive
    still_pressure: Positive
    degraded: DegradedSettings | None = None

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        if self.neutral >= self.opening:
            raise ValueError(
                f"neutral is {self.neutral}, it must be less than opening, {self.opening}: what "
                "moves nothing cannot surely move a joint"
            )
        return self


def load_safety(path: Path | str, machine: Machine) -> SafetySettings:
    """The settings in `path`; `ConfigurationError` if wrong, or not of the joints of `machine`."""
    settings = load(path, SafetySettings)
    of_every_joint(settings.deceleration, machine.joint_names, f"{path}: key 'deceleration'")
    permitted = settings.degraded.deviation if settings.degraded else {}
    if unknown := [joint for joint in permitted if joint not in machine.joint_names]:
        raise ConfigurationError(
            f"{path}: key 'degraded.deviation' names {', '.join(unknown)}; the joints are "
            f"{', '.join(machine.joint_names)}"
        )
    return settings


MARGIN = 0.002  # rad, m, before a limit where motion ends: what a valve does while it closes again
FAR = 0.2  # of the speed of Table 2, beyond what is allowed
LEAST = 0.005  # of the spool beyond neutral; less than that tells nothing of the speed it gives


class JointLimiter:
    """Limits the spool command of one joint by its measured position and velocity.

    Towards a limit at distance d, less the margin, the allowed speed is sqrt(2 a d), at most that
    of Table 2 or a share of it. The spool opens only so fast that the speed can be watched, and no
    further than an allowed speed can need at most.

    If the joint is too fast all the same, as valve, load and oil may have it, the spool is held
    from then on where it gives the allowed speed, by the speed that an opening beyond neutral has
    given in the mean of late. A mean, because a limit that follows each swing of a load on its oil
    drives it. If the joint is far too fast, or faster than it can brake, its spool is closed at
    once in the ratio of the allowed to the measured speed. A joint that is about to reach its
    limit, but for the margin, within the reaction time is commanded to neutral; one that has
    reached it may only be commanded away from it.
    """

    def __init__(self, limits: JointLimits, deceleration: float, settings: SafetySettings):
        self._limits, self._deceleration = limits, deceleration
        self._reaction, self._correction = settings.reaction_time, settings.correction_time
        self._opening, self._opening_time = settings.opening, settings.opening_time
        self._neutral = settings.neutral
        self.restart()

    def restart(self, share: float = 1.0) -> None:
        """Begin at neutral, whatever was sent before, with a `share` of the speed of Table 2."""
        self._share = share
        self._start(0.0)

    def _start(self, direction: float) -> None:
        self._direction = direction
        self._sent = 0.0
        self._cause = 0.0  # the spool that the present speed comes from
        self._was_too_fast = False
        self._mean_speed, self._mean_opening = 0.0, LEAST

    def limit(self, command: float, position: float, velocity: float, dt: float) -> float:
        """`command` (-1 to 1), or a smaller one of the same sign, `dt` [s] after the last call.

        Units of position and velocity: rad, rad/s or m, m/s; both finite.
        """
        direction = math.copysign(1.0, command) if command else 0.0
        if direction != self._direction:
            self._start(direction)
        self._cause += (self._sent - self._cause) * min(1.0, dt / self._reaction)
        bound = self._bound(direction, position, velocity, dt)
        self._sent = min(abs(command), self._opened(dt), bound)
        return direction * self._sent

    def _opened(self, dt: float) -> float:
        """How far the spool may be open by now. Where a share of the speed is allowed, it is to be
        watched for longer, by as much, on a way that is as much shorter.
        """
        at_once = self._neutral + self._share * (self._opening - self._neutral)
        return max(self._sent, at_once) + self._share**2 * dt / self._opening_time

    def _bound(self, direction: float, position: float, velocity: float, dt: float) -> float:
        """The largest spool in a direction."""
        limits = self._limits
        if direction > 0.0:
            distance, fastest = limits.position_max - position, limits.velocity_max
        else:
            distance, fastest = position - limits.position_min, -limits.velocity_min
        distance -= MARGIN
        speed = direction * velocity
        if distance <= max(0.0, speed * self._reaction):
            return 0.0
        permitted, brake = self._share * fastest, math.sqrt(2.0 * self._deceleration * distance)
        allowed = min(permitted, brake)
        opening = max(self._cause - self._neutral, LEAST)
        weight = min(1.0, self._share * dt / self._correction)
        self._mean_speed += (speed - self._mean_speed) * weight
        self._mean_opening += (opening - self._mean_opening) * weight
        self._was_too_fast |= speed > allowed
        bound = self._opening + (1.0 - self._opening) * allowed / fastest
        if self._was_too_fast and self._mean_speed > 0.0:
            bound = min(bound, self._neutral + self._mean_opening * allowed / self._mean_speed)
        if speed > min(permitted + FAR * fastest, brake):
            bound = min(bound, self._neutral + opening * allowed / speed)
        return bound
