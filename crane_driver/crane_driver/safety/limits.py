"""Table 2 kept: speed limited by the braking distance, and no motion into a limit."""

import math

from crane_driver.safety.settings import SafetySettings
from crane_model.machine import JointLimits

MARGIN = 0.002  # rad, m, before a limit where motion ends: what a valve does while it closes again


class JointLimiter:
    """Limits the spool command of one joint by its measured position and velocity.

    Towards a limit at distance d, less the margin, the allowed speed is sqrt(2 a d), at most that
    of Table 2. The spool opens only so fast that the speed can be watched, and no further than an
    allowed speed can need at most. If the joint is too fast all the same, as valve, load and oil
    may have it, the spool is closed in the ratio of the allowed to the measured speed, and opens
    again in the measure in which the joint is too slow. A joint that is about to reach its limit,
    but for the margin, within the reaction time is commanded to neutral; one that has reached it
    may only be commanded away from it.
    """

    def __init__(self, limits: JointLimits, deceleration: float, settings: SafetySettings):
        self._limits, self._deceleration = limits, deceleration
        self._reaction = settings.reaction_time
        self._correction = settings.correction_time
        self._opening, self._opening_time = settings.opening, settings.opening_time
        self.restart()

    def restart(self, share: float = 1.0) -> None:
        """Begin at neutral, whatever was sent before, with a `share` of the speed of Table 2."""
        self._share = share
        self._start(0.0)

    def _start(self, direction: float) -> None:
        self._direction = direction
        self._cap = 1.0
        self._sent = 0.0
        self._cause = 0.0  # the opening that the present speed comes from

    def limit(self, command: float, position: float, velocity: float, dt: float) -> float:
        """`command` (-1 to 1), or a smaller one of the same sign, `dt` [s] after the last call.

        Units of position and velocity: rad, rad/s or m, m/s; both finite.
        """
        direction = math.copysign(1.0, command) if command else 0.0
        if direction != self._direction:
            self._start(direction)
        self._cause += (self._sent - self._cause) * min(1.0, dt / self._reaction)
        opened = max(self._sent, self._opening) + dt / self._opening_time
        bound = self._bound(direction, position, velocity, dt)
        self._sent = min(abs(command), opened, bound)
        return direction * self._sent

    def _bound(self, direction: float, position: float, velocity: float, dt: float) -> float:
        """The largest spool opening in a direction."""
        limits = self._limits
        if direction > 0.0:
            distance, fastest = limits.position_max - position, limits.velocity_max
        else:
            distance, fastest = position - limits.position_min, -limits.velocity_min
        distance -= MARGIN
        speed = direction * velocity
        if distance <= max(0.0, speed * self._reaction):
            self._cap = 0.0
            return 0.0
        allowed = min(self._share * fastest, math.sqrt(2.0 * self._deceleration * distance))
        excess = (speed - allowed) / fastest
        self._cap = min(1.0, max(0.0, self._cap - excess * dt / self._correction))
        if excess > 0.0:
            self._cap = min(self._cap, self._cause * allowed / speed)
        return min(self._cap, self._opening + (1.0 - self._opening) * allowed / fastest)
