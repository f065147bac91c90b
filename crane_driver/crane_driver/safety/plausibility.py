"""Encoders that cannot be trusted: frozen, jumping, found faulty, or replaced by an estimate."""

import math
from collections.abc import Collection, Mapping, Sequence
from typing import NamedTuple, Self

from crane_driver import constants
from crane_driver.faults import Fault, FaultKind
from crane_driver.safety.commands import DegradedSettings, RefusedError, SafetySettings
from crane_model.machine import JointLimits

USABLE_CONDITIONS = ("GOOD", "ENCODER_LOST")  # conditions of an estimate that may lead a joint


class _Stillness:
    """How long a reading has not changed while the valve was open one way beyond `threshold`."""

    def __init__(self, threshold: float, margin: float):
        self._threshold, self._margin = threshold, margin
        self._direction = 0.0
        self._since = self._lowest = self._highest = math.nan
        self._pressures: Sequence[float] = (math.nan, math.nan)

    def observe(
        self, time: float, position: float, command: float, pressures: Sequence[float]
    ) -> float:
        direction = math.copysign(1.0, command) if abs(command) > self._threshold else 0.0
        if position < self._lowest:
            self._lowest = position
        elif position > self._highest:
            self._highest = position
        still = self._highest - self._lowest <= self._margin
        if not still or not direction or direction != self._direction:
            self._direction = direction
            self._since, self._pressures = time, pressures
            self._lowest = self._highest = position
        return time - self._since

    def pressure_change(self, pressures: Sequence[float]) -> float:
        """The largest change of a pressure [Pa] since the reading has not changed."""
        return max(abs(a - b) for a, b in zip(pressures, self._pressures, strict=True))


class PositionWatch:
    """Judges the reading of a joint by what its valve was sent and by what it can do at most.

    What is not believed stays so until there is a new watch.
    """

    def __init__(
        self,
        joint: str,
        limits: JointLimits,
        resolution: float,
        cycle: float,
        settings: SafetySettings,
    ):
        """`resolution`: one step of the encoder [rad, m]; `cycle`: of its message [s]."""
        fastest = limits.top_speed
        self._speed, self._margin = (
            settings.jump_speed * fastest,
            constants.STILL_STEPS * resolution,
        )
        self._joint, self._cycle, self._settings = joint, cycle, settings
        self.chambers = f"{joint}.a", f"{joint}.b"  # names of its pressures
        self._driven = _Stillness(settings.opening, self._margin)
        self._pressed = _Stillness(settings.neutral, self._margin)
        self._time, self._position = math.nan, math.nan
        self.believed = True

    def observe(
        self, time: float, position: float, command: float, pressures: Sequence[float]
    ) -> Fault | None:
        """Return the new findings about a reading at `time` [s].

        `command`: the last command of the valve (-1 to 1); `pressures` [Pa] of both chambers, NaN
        if not measured.
        """
        if not self.believed or not math.isfinite(position):
            return None
        wrong = self._jumped(time, position) or self._still(time, position, command, pressures)
        self._time, self._position = time, position
        self.believed = wrong is None
        return wrong

    def _jumped(self, time: float, position: float) -> Fault | None:
        change, elapsed = position - self._position, max(time - self._time, self._cycle)
        if not abs(change) > self._speed * elapsed + self._margin:  # nor the first, from NaN
            return None
        detail = (
            f"its position jumped by {change:.3g} in {elapsed * 1e3:.0f} ms, the joint can move "
            f"by {self._speed * elapsed:.2g}"
        )
        return Fault(FaultKind.JUMPED, detail, self._joint)

    def _still(
        self, time: float, position: float, command: float, pressures: Sequence[float]
    ) -> Fault | None:
        longest = self._settings.still_time
        driven = self._driven.observe(time, position, command, pressures)
        pressed = self._pressed.observe(time, position, command, pressures)
        if driven > longest:
            why = f"for {driven * 1e3:.0f} ms with its valve open by {abs(command):.2f}"
        elif pressed > longest and (
            (change := self._pressed.pressure_change(pressures)) > self._settings.still_pressure
        ):
            why = (
                f"for {pressed * 1e3:.0f} ms while its pressures changed by {change / 1e5:.0f} bar"
            )
        else:
            return None
        return Fault(FaultKind.FROZEN, f"its position has not changed {why}", self._joint)


def believed(
    watches: Mapping[str, PositionWatch],
    time: float,
    positions: Mapping[str, float],
    commands: Mapping[str, float],
    pressures: Mapping[str, float],
) -> tuple[dict[str, float], list[Fault]]:
    """The positions, NaN where they are not believed, and what is newly wrong."""
    found, wrong = dict(positions), []
    for joint, watch in watches.items():
        chambers = [pressures.get(name, math.nan) for name in watch.chambers]
        if fault := watch.observe(time, positions[joint], commands[joint], chambers):
            wrong.append(fault)
        if not watch.believed:
            found[joint] = math.nan
    return found, wrong


class FaultyEncoders:
    """Those that were found since the driver began, until the monitor forgets them.

    What was found before concerns readings that this driver never made: it is told, and nothing
    follows from it.
    """

    def __init__(self) -> None:
        self._standing: dict[str, str] = {}  # joint: what is wrong
        self._before: set[str] = set()  # joints

    def take(self, told: Mapping[str, str], before: bool) -> tuple[list[Fault], list[str]]:
        """Return the monitor's new findings, joint by joint, and the lines to log.

        before: whether they were found before the driver began.
        """
        old = set(told) if before else self._before & set(told)
        warnings = [
            f"{joint}: {told[joint]}, found before this driver started: ignored; if it is not "
            "repaired, repair it, then let sensor_monitor forget it"
            for joint in sorted(old - self._before)
        ]
        faults = [
            Fault(FaultKind.FAULTY_ENCODER, what, joint)
            for joint, what in told.items()
            if joint not in old and joint not in self._standing
        ]
        self._before = old
        self._standing = {joint: what for joint, what in told.items() if joint not in old}
        return faults, warnings

    def problem(self, substituted: str) -> str:
        """Reason against enabling; empty if none. A `substituted` encoder is not believed."""
        wrong = [
            f"{joint}: {what}" for joint, what in self._standing.items() if joint != substituted
        ]
        if not wrong:
            return ""
        return (
            f"{'; '.join(wrong)}; repair it and let sensor_monitor forget it, or go on without it "
            "by substitute"
        )


class JointEstimate(NamedTuple):
    """Estimate of a joint that turns [rad, rad/s] or slides [m, m/s]."""

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
        """Take a newer estimate; one that is NaN, older, or of the future is left out."""
        newer = self._newest is None or estimate.time > self._newest.time
        if newer and estimate.time <= now and all(map(math.isfinite, estimate[:-1])):
            self._newest = estimate

    def problem(self, now: float) -> str:
        """Why the estimate may not be used at `now` [s]; empty if it may."""
        if self._newest is None:
            return "no estimate of its position has arrived; start position_estimator"
        age, deviation = now - self._newest.time, self._newest.deviation
        if age > self._settings.timeout:
            return (
                f"its estimate is {age * 1e3:.0f} ms old, limit "
                f"{self._settings.timeout * 1e3:.0f} ms"
            )
        if self._newest.condition not in USABLE_CONDITIONS:
            return f"its estimate is {self._newest.condition}, not {' or '.join(USABLE_CONDITIONS)}"
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
        return position + math.copysign(constants.CAUTION_SIGMAS * self._newest.deviation, command)
