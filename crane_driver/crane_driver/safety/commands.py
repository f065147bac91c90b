"""Valve commands: their settings, checks and limits, and how they follow one another."""

import math
from collections.abc import Collection, Sequence
from pathlib import Path
from typing import Annotated, Self

from pydantic import Field, model_validator

from crane_driver import constants
from crane_driver.faults import Fault, FaultKind
from crane_model.configuration import Positive, Schema, load
from crane_model.errors import ConfigurationError, CraneError, RangeError
from crane_model.machine import JointLimits, Machine
from crane_model.machine_files import of_every_joint

CommandShare = Annotated[float, Field(gt=0, lt=1)]


class DegradedSettings(Schema):
    """When a joint may go on by an estimate in the place of its encoder."""

    speed: Annotated[float, Field(gt=0, le=1)]  # share of that of Table 2, of every joint
    timeout: Positive  # s
    deviation: dict[str, Positive]  # joint: rad, m; others have no substitute


class SafetySettings(Schema):
    """Settings of the safety functions: times [s], shares of the valve command, decelerations [SI].

    Their meaning stands in the `safety.yaml` of a machine.
    """

    command_timeout: Positive
    ramp_time: Positive
    neutral: CommandShare
    settling_time: Positive
    deceleration: dict[str, Positive]  # joint
    reaction_time: Positive
    correction_time: Positive
    opening: CommandShare
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
    """Read the settings of the safety functions.

    Parameters
    ----------
    path
        File `safety.yaml`.
    machine
        Machine whose joints it names.

    Returns
    -------
    SafetySettings
        The settings.

    Raises
    ------
    ConfigurationError
        If a setting is wrong, or the joints are not those of the machine.

    Examples
    --------
    >>> from crane_model import load_machine
    >>> from crane_model.machine_files import machine_file
    >>> settings = load_safety(machine_file("safety.yaml"), load_machine())
    >>> settings.neutral < settings.opening
    True
    """
    settings = load(path, SafetySettings)
    of_every_joint(settings.deceleration, machine.joint_names, f"{path}: key 'deceleration'")
    permitted = settings.degraded.deviation if settings.degraded else {}
    if unknown := [joint for joint in permitted if joint not in machine.joint_names]:
        raise ConfigurationError(
            f"{path}: key 'degraded.deviation' names {', '.join(unknown)}; the joints are "
            f"{', '.join(machine.joint_names)}"
        )
    return settings


class JointLimiter:
    """Limits the valve command of one joint by its measured position and velocity.

    Towards a limit at distance d, less the margin, the allowed speed is sqrt(2 a d), at most that
    of Table 2 or a share of it. The valve opens only so fast that the speed can be watched, and no
    further than an allowed speed can need at most.

    If the joint is too fast all the same, as valve, load and oil may have it, the valve is held
    from then on where it gives the allowed speed, by the speed that an opening beyond neutral has
    given in the mean of late. A mean, because a limit that follows each swing of a load on its oil
    drives it. If the joint is far too fast, or faster than it can brake, its valve is closed at
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
        self._cause = 0.0  # the command that the present speed comes from
        self._was_too_fast = False
        self._mean_speed, self._mean_opening = 0.0, constants.LEAST_OPENING

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
        """How far the valve may be open by now. If a share of the speed is allowed, it opens more
        slowly by its square: the joint is watched for longer, on a shorter path.
        """
        at_once = self._neutral + self._share * (self._opening - self._neutral)
        return max(self._sent, at_once) + self._share**2 * dt / self._opening_time

    def _bound(self, direction: float, position: float, velocity: float, dt: float) -> float:
        limits = self._limits
        if direction > 0.0:
            distance, fastest = limits.position_max - position, limits.velocity_max
        else:
            distance, fastest = position - limits.position_min, -limits.velocity_min
        distance -= constants.LIMIT_MARGIN
        speed = direction * velocity
        if distance <= max(0.0, speed * self._reaction):
            return 0.0
        permitted, brake = self._share * fastest, math.sqrt(2.0 * self._deceleration * distance)
        allowed = min(permitted, brake)
        opening = max(self._cause - self._neutral, constants.LEAST_OPENING)
        weight = min(1.0, self._share * dt / self._correction)
        self._mean_speed += (speed - self._mean_speed) * weight
        self._mean_opening += (opening - self._mean_opening) * weight
        self._was_too_fast |= speed > allowed
        bound = self._opening + (1.0 - self._opening) * allowed / fastest
        if self._was_too_fast and self._mean_speed > 0.0:
            bound = min(bound, self._neutral + self._mean_opening * allowed / self._mean_speed)
        if speed > min(permitted + constants.FAR_TOO_FAST_SHARE * fastest, brake):
            bound = min(bound, self._neutral + opening * allowed / speed)
        return bound


class RefusedError(CraneError):
    """A request to the driver was refused; nothing has changed.

    Examples: enabling while a command is not neutral, resetting while the ramp runs, a command
    with a value that is not a number.
    """


def check_valves(valves: Sequence[str], positions: Sequence[str]) -> None:
    """`ConfigurationError` where a joint has a valve but no position to keep its limits by."""
    if blind := [joint for joint in valves if joint not in positions]:
        raise ConfigurationError(
            f"mapping: {', '.join(blind)} can be commanded, but there is no position to keep the "
            "joint limits by; map one, or remove the command"
        )


def check_command(
    names: Sequence[str], values: Sequence[float], valves: Collection[str]
) -> dict[str, float]:
    """The commands by joint; joints of `valves` that are not named are neutral.

    `RangeError` refuses the whole command and names the joint, the limits and the value.
    """
    if len(names) != len(values):
        raise RangeError(
            f"valve command has {len(names)} names and {len(values)} values; one value a name"
        )
    commands = dict.fromkeys(valves, 0.0)
    seen: set[str] = set()
    for name, value in zip(names, values, strict=True):
        if name not in commands:
            raise RangeError(
                f"valve command for '{name}', but there are valves for {', '.join(valves)}"
            )
        if name in seen:
            raise RangeError(f"valve command names {name} twice")
        if not -1.0 <= value <= 1.0:  # refuses what is not a number, too
            raise RangeError(f"valve command for {name} is {value}, limits -1 and 1")
        seen.add(name)
        commands[name] = float(value)
    return commands


def ramped(command: float, step: float) -> float:
    """A valve command that is `step` nearer to neutral, and never beyond it."""
    return max(command - step, 0.0) if command > 0.0 else min(command + step, 0.0)


class CommandSeries:
    """Times are of the steady clock [s]."""

    def __init__(self, valves: Sequence[str], settings: SafetySettings):
        self._valves, self._settings = tuple(valves), settings
        self._received = -math.inf  # when the last good command came
        self._from_neutral = False  # whether a neutral command has begun the present series
        self.target = dict.fromkeys(self._valves, 0.0)
        self.publishers = 0
        self.refused = 0  # commands
        self.refusal = ""  # why the last one was

    @property
    def is_neutral(self) -> bool:
        return all(abs(value) <= self._settings.neutral for value in self.target.values())

    @property
    def several(self) -> str:
        return f"{self.publishers} publishers command the valves" if self.publishers > 1 else ""

    def __str__(self) -> str:
        return ", ".join(f"{joint} {value:.3g}" for joint, value in self.target.items() if value)

    def take(
        self, names: Sequence[str], values: Sequence[float], received: float, moves: bool
    ) -> None:
        """Take a command that came at `received`; `RefusedError` if it is refused as a whole.

        moves: whether commands reach the valves; then a series begins with a neutral one.
        """
        before = self.target
        try:
            if self.several:
                raise RangeError(f"{self.several}, one may")
            self.target = check_command(names, values, self._valves)
            begun = (moves and self._from_neutral) or self.is_neutral
            if moves and not begun:
                raise RangeError(
                    f"the first command is {self}; begin with a neutral one, at most "
                    f"{self._settings.neutral}"
                )
        except RangeError as error:
            self.target = before
            self.refused += 1
            self.refusal = f"{error}; the whole command is refused"
            raise RefusedError(self.refusal) from None
        self._from_neutral, self._received = begun, received

    def fresh(self, now: float) -> bool:
        """Return whether the last command is not too old."""
        return now - self._received <= self._settings.command_timeout

    def begin(self, now: float) -> None:
        self._from_neutral = self.fresh(now)

    def end(self) -> None:
        self._from_neutral = False

    def overdue(self, now: float) -> Fault | None:
        """End where no command comes any more: well, if the last was neutral, else with a fault."""
        if self.fresh(now):
            return None
        fault = None
        if self._from_neutral and not self.is_neutral:
            detail = (
                f"last command {(now - self._received) * 1e3:.0f} ms ago, limit "
                f"{self._settings.command_timeout * 1e3:.0f} ms, it was {self}"
            )
            fault = Fault(FaultKind.COMMAND_TIMEOUT, detail)
        self.end()
        self.target = dict.fromkeys(self._valves, 0.0)
        return fault
