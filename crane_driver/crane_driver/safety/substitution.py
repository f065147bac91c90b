"""One joint that goes on by an estimate, because its encoder is lost."""

import math
from collections.abc import Collection
from typing import NamedTuple, Self

from crane_driver.safety.commands import RefusedError
from crane_driver.safety.settings import DegradedSettings

USABLE = ("GOOD", "ENCODER_LOST")  # conditions of an estimate that may lead a joint
CAUTION = 3.0  # standard deviations, by which an estimate may be wrong


class JointEstimate(NamedTuple):
    """What is told of a joint that turns [rad, rad/s] or slides [m, m/s]."""

    time: float  # s, steady, of the readings that it rests on
    position: float
    velocity: float
    deviation: float  # standard deviation of the position
    condition: str  # of the estimate, by name


class Substitution:
    """The newest estimate of a joint, and whether it may take the place of its encoder."""

    def __init__(self, joint: str, settings: DegradedSettings):
        self.joint = joint
        self._settings = settings
        self._newest: JointEstimate | None = None

    @classmethod
    def permitted(
        cls, joint: str, valves: Collection[str], settings: DegradedSettings | None
    ) -> Self:
        """`RefusedError` where the settings do not allow it."""
        if joint not in valves:
            raise RefusedError(
                f"no substitute for {joint}: there are valves for {', '.join(valves)}"
            )
        if settings is None or joint not in settings.deviation:
            raise RefusedError(
                f"no substitute for {joint}: degraded.deviation of safety.yaml does not name it"
            )
        return cls(joint, settings)

    def tell(self, estimate: JointEstimate, now: float) -> None:
        """Take a newer estimate; one that is no number, older than the last, or of the future is
        left out, so that it is missed.
        """
        newer = self._newest is None or estimate.time > self._newest.time
        if newer and estimate.time <= now and all(map(math.isfinite, estimate[:-1])):
            self._newest = estimate

    def problem(self, now: float) -> str:
        """Why the estimate may not be used at `now` [s]; empty if it may."""
        if self._newest is None:
            return "no estimate of its position has come; start position_sensor"
        age, deviation = now - self._newest.time, self._newest.deviation
        if age > self._settings.timeout:
            return (
                f"its estimate is {age * 1e3:.0f} ms old, limit "
                f"{self._settings.timeout * 1e3:.0f} ms"
            )
        if self._newest.condition not in USABLE:
            return f"its estimate is {self._newest.condition}, not {' or '.join(USABLE)}"
        if deviation > self._settings.deviation[self.joint]:
            return (
                f"the standard deviation of its estimate is {deviation:.3g}, limit "
                f"{self._settings.deviation[self.joint]:g}"
            )
        return ""

    def motion(self, now: float) -> tuple[float, float]:
        """Position and velocity, as the joint went on since; NaN where they may not be used."""
        if self._newest is None or self.problem(now):
            return math.nan, math.nan
        went_on = self._newest.velocity * (now - self._newest.time)
        return self._newest.position + went_on, self._newest.velocity

    def towards(self, command: float, now: float) -> float:
        """The position as far in the direction of a command as it may be."""
        position, _ = self.motion(now)
        if self._newest is None or not command:
            return position
        return position + math.copysign(CAUTION * self._newest.deviation, command)
