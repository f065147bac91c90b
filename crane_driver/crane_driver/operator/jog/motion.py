"""From what is held to what is commanded: one joint at a time, ramped, from neutral to neutral."""

import math
from collections.abc import Mapping
from typing import NamedTuple

from crane_driver.operator.wording import LONGEST_PAUSE_S
from crane_model.errors import ConfigurationError


class Demand(NamedTuple):
    """What a hand asks for at a moment."""

    joint: str
    level: float  # -1 to 1, of the fastest


class CommandShape(NamedTuple):
    """How demands become spool commands."""

    maximum: float  # spool command at level 1
    dead_band: Mapping[str, float]  # joint: spool command that does not move it yet
    rise_time: float  # s, from neutral to level 1
    fall_time: float  # s, back


class JogMotion:
    """Spool commands from demands. All times are of the steady clock [s].

    A demand counts only after a moment without one: what is held when it begins, or after a pause,
    has to be let go first. A joint that is commanded reaches neutral before another one, or the
    other direction, begins.
    """

    def __init__(self, shape: CommandShape):
        """`ConfigurationError` where a dead band leaves no room below the maximum."""
        for joint, dead_band in shape.dead_band.items():
            if dead_band >= shape.maximum:
                raise ConfigurationError(
                    f"parameter 'dead_band.{joint}': must be less than 'maximum', "
                    f"{shape.maximum:g}, got {dead_band:g}"
                )
        self._shape = shape
        self._joint, self._level = next(iter(shape.dead_band)), 0.0
        self._stepped = -math.inf
        self._let_go = False

    @property
    def neutral(self) -> bool:
        """Whether the newest commands are all neutral."""
        return self._level == 0.0

    def step(self, demand: Demand | None, now: float) -> dict[str, float]:
        """The commands (-1 to 1) of all joints at `now`, while `demand` is held."""
        dt, self._stepped = now - self._stepped, now
        if dt > LONGEST_PAUSE_S:  # everything begins at neutral again
            self._level, self._let_go = 0.0, False
        if demand is None:
            self._let_go = True
        else:
            demand = demand if self._let_go else None
        self._approach(demand, dt)
        commands = dict.fromkeys(self._shape.dead_band, 0.0)
        if self._level:
            shape, dead_band = self._shape, self._shape.dead_band[self._joint]
            size = dead_band + abs(self._level) * (shape.maximum - dead_band)
            commands[self._joint] = math.copysign(size, self._level)
        return commands

    def _approach(self, demand: Demand | None, dt: float) -> None:
        if self._level == 0.0 and demand:
            self._joint = demand.joint
        wanted = demand.level if demand and demand.joint == self._joint else 0.0
        level = self._level
        if (level * wanted > 0.0 and abs(wanted) > abs(level)) or level == 0.0:
            step = dt / self._shape.rise_time
        else:
            step = dt / self._shape.fall_time
            if level * wanted < 0.0:
                wanted = 0.0
        self._level = min(wanted, level + step) if wanted > level else max(wanted, level - step)
