"""What the steps of a bring-up record: samples of all joints, and the trace of one of them."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from crane_model.errors import DataError

COUNTS = 10.0  # of the encoder, or standard deviations of its noise: what counts as a movement
ROTARY = 2.0 * np.pi  # rad, after which an encoder of one turn begins anew


class Sample(NamedTuple):
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
    """A joint that stands still: position and noise of its encoder [rad, m]."""

    position: float
    noise: float  # standard deviation of one reading
    resolution: float

    @property
    def movement(self) -> float:
        """The least displacement that cannot be noise [rad, m]."""
        return COUNTS * max(self.noise, self.resolution)


def at_rest(name: str, readings: np.ndarray, resolution: float, period: float | None) -> Rest:
    """Mean and noise of readings (n,) of a joint at rest [rad, m].

    With a `period` the mean is that of the circle, so that readings to either side of the wrap of
    an encoder do not cancel. `DataError` if the joint moved meanwhile: its two halves differ by
    more than a movement.
    """
    if period is None:
        middle = float(np.mean(readings))
    else:
        angle = np.angle(np.mean(np.exp(2j * np.pi * (readings - readings[0]) / period)))
        middle = float(readings[0] + angle * period / (2.0 * np.pi))
        readings = middle + (readings - middle + period / 2.0) % period - period / 2.0
    half = len(readings) // 2
    rest = Rest(middle, float(np.std(readings)), resolution)
    drift = abs(float(np.mean(readings[half:]) - np.mean(readings[:half])))
    # not in units of the noise, which a drift would itself raise
    if drift > COUNTS * resolution:
        raise DataError(
            f"{name} is not at rest: it drifted by {drift:.3g} in {len(readings)} readings, limit "
            f"{COUNTS * resolution:.3g}; let it settle and measure again"
        )
    return rest
