"""What the steps of a bring-up record: samples of all joints, and the trace of one of them."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from crane_model.errors import DataError

COUNTS = 10.0  # of the encoder, or standard deviations of its noise: what counts as a movement
SINKING = 1e-3  # rad/s, m/s: a joint that leaks is slower, one that is moved is faster
BLOCK = 0.5  # s
FEWEST = 10  # readings of a joint at rest
ROTARY = 2.0 * np.pi  # rad, after which an encoder of one turn begins anew


class JointInstant(NamedTuple):
    """The joints at one instant, in the order of the crane's joints."""

    time: float  # s
    position: np.ndarray  # (j,) rad, m
    velocity: np.ndarray  # (j,) rad/s, m/s


@dataclass(frozen=True)
class Trace:
    """n samples of one joint while it was commanded."""

    time: np.ndarray  # (n,) s, rising
    position: np.ndarray  # (n,) rad, m
    command: np.ndarray  # (n,) -1..1, the one that stood at `time`

    def turned(self, direction: int) -> "Trace":
        """The trace as it is when positive and negative are exchanged, for `direction` -1."""
        return Trace(self.time, direction * self.position, direction * self.command)


@dataclass(frozen=True)
class Rest:
    """A joint that stands, or sinks by leakage, at the beginning of a record."""

    position: float  # rad, m: at the beginning
    noise: float  # rad, m: standard deviation of one reading
    resolution: float  # rad, m
    sinking: float = 0.0  # rad/s, m/s

    @property
    def movement(self) -> float:
        """The least displacement that cannot be noise [rad, m]."""
        return COUNTS * max(self.noise, self.resolution)


def at_rest(
    name: str, time: np.ndarray, readings: np.ndarray, resolution: float, period: float | None
) -> Rest:
    """A line through readings (n,) of a joint at rest [rad, m], at least `FEWEST`, at `time` [s].

    With a `period` the mean is that of the circle, so that readings to either side of the wrap of
    an encoder do not cancel. `DataError` if the joint moved meanwhile, and not as one that sinks.
    """
    if period is not None:
        angle = np.angle(np.mean(np.exp(2j * np.pi * (readings - readings[0]) / period)))
        middle = float(readings[0] + angle * period / (2.0 * np.pi))
        readings = middle + (readings - middle + period / 2.0) % period - period / 2.0
    since = time - time[0]
    seconds = float(np.ptp(since))
    rate, first = (float(one) for one in np.polyfit(since, readings, 1))
    noise = float(np.std(readings - first - rate * since))
    drift, allowed = rate * seconds, max(COUNTS * resolution, SINKING * seconds)
    # not in units of the noise, which a motion would itself raise
    if not abs(drift) <= allowed:
        raise DataError(
            f"{name} is not at rest: it drifted by {drift:+.3g} in {seconds:.3g} s, allowed "
            f"±{allowed:.3g}; let it settle and measure again. If it sinks so fast by itself, "
            "support it, or mend the leak"
        )
    return Rest(first, noise, resolution, rate)


def moved(time: np.ndarray, position: np.ndarray, rest: Rest) -> float:
    """How far a joint went (n,) [rad, m] that was moved, without what it sank before and after.

    It sinks for as long as the operator takes; what goes faster than `SINKING` was moved. Means of
    `BLOCK` take shaking out.
    """
    since = time - time[0]
    _, block, count = np.unique(since // BLOCK, return_inverse=True, return_counts=True)
    at, where = (np.bincount(block, values) / count for values in (since, position))
    way = np.diff(where)
    fast = np.abs(way) > SINKING * np.diff(at) + 2.0 * max(rest.noise, rest.resolution)
    return float(way[fast].sum())
