"""Positions that no joint can have: an encoder that is frozen, or that jumps, is not believed."""

import math
from collections.abc import Mapping, Sequence

from crane_driver.faults import Fault, FaultKind
from crane_driver.safety.settings import SafetySettings
from crane_model.machine import JointLimits

STILL_STEPS = 3.0  # of the encoder, within which a reading counts as unchanged


class _Stillness:
    """How long a reading has not changed while the valve was open one way by more than `spool`."""

    def __init__(self, spool: float, margin: float):
        self._spool, self._margin = spool, margin
        self._direction = 0.0
        self._since = self._lowest = self._highest = math.nan
        self._pressures: Sequence[float] = (math.nan, math.nan)

    def observe(
        self, time: float, position: float, spool: float, pressures: Sequence[float]
    ) -> float:
        """How long it has not changed [s]."""
        direction = math.copysign(1.0, spool) if abs(spool) > self._spool else 0.0
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
        fastest = max(limits.velocity_max, -limits.velocity_min)
        self._speed, self._margin = settings.jump_speed * fastest, STILL_STEPS * resolution
        self._joint, self._cycle, self._settings = joint, cycle, settings
        self.chambers = f"{joint}.a", f"{joint}.b"  # names of its pressures
        self._driven = _Stillness(settings.opening, self._margin)
        self._pressed = _Stillness(settings.neutral, self._margin)
        self._time, self._position = math.nan, math.nan
        self.believed = True

    def observe(
        self, time: float, position: float, spool: float, pressures: Sequence[float]
    ) -> Fault | None:
        """What is newly wrong with a reading at `time` [s].

        `spool`: what the valve was last sent (-1 to 1); `pressures` [Pa] of both chambers,
        NaN where they are not measured.
        """
        if not self.believed or not math.isfinite(position):
            return None
        wrong = self._jumped(time, position) or self._still(time, position, spool, pressures)
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
        self, time: float, position: float, spool: float, pressures: Sequence[float]
    ) -> Fault | None:
        longest = self._settings.still_time
        driven = self._driven.observe(time, position, spool, pressures)
        pressed = self._pressed.observe(time, position, spool, pressures)
        if driven > longest:
            why = f"for {driven * 1e3:.0f} ms with its valve open by {abs(spool):.2f}"
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
    spools: Mapping[str, float],
    pressures: Mapping[str, float],
) -> tuple[dict[str, float], list[Fault]]:
    """The positions, NaN where they are not believed, and what is newly wrong."""
    found, wrong = dict(positions), []
    for joint, watch in watches.items():
        chambers = [pressures.get(name, math.nan) for name in watch.chambers]
        if fault := watch.observe(time, positions[joint], spools[joint], chambers):
            wrong.append(fault)
        if not watch.believed:
            found[joint] = math.nan
    return found, wrong
