"""From the readings of three topics to samples: encoders at the stamps of pressures."""

from enum import Enum

import numpy as np

from crane_model.array import Array
from crane_model.errors import ConfigurationError, DataError
from crane_model.model_file import Model
from crane_observer.monitor.alone import SensorsAlone
from crane_observer.monitor.blocks import LONGEST, KnownFlow, Sample
from crane_observer.monitor.finding import SensorFinding
from crane_observer.monitor.monitor import SensorComparison
from crane_observer.monitor.tolerance import Tolerance, unlearnt

WAITING_ROOM = 100  # readings of pressures that wait for an encoder


class Heed(Enum):
    """Whether sensors can be compared."""

    WAITING = "waits for encoders, pressures and valve commands"
    WATCHING = "compares all sensors"
    ALONE = "the model holds no hydraulics: each sensor is watched by itself, none is compared"
    GAP = "readings are missing: compares again as soon as they come"


class SensorWatch:
    """Takes readings as they come, and gives findings."""

    def __init__(self, model: Model, tolerance: Tolerance | None = None):
        """Where the model has no hydraulics, every sensor by itself; `ConfigurationError` if there
        is a tolerance then. Else without one a wide one is assumed.
        """
        self.monitor: SensorComparison | SensorsAlone
        if model.hydraulics is None:
            if tolerance is not None:
                raise ConfigurationError(
                    f"model '{model.name}': holds no hydraulics, and no comparison that a "
                    "tolerance could be of; identify them, or leave the tolerance away"
                )
            self.monitor, self._heed = SensorsAlone(model), Heed.ALONE
        else:
            physics = KnownFlow.of(model)
            self.monitor = SensorComparison(physics, tolerance or unlearnt(physics.joints))
            self._heed = Heed.WATCHING
        self.condition = Heed.WAITING
        self.refused = 0  # samples
        self.last_refusal = ""
        self._encoders: list[tuple[float, Array]] = []
        self._pressures: list[tuple[float, Array, Array, float]] = []
        self._commanded = model.hydraulics is None  # commands are not asked for then

    def add_command(self, time: float, command: Array) -> None:
        """(j,) -1..1, in force from `time` [s] on."""
        self._commanded = True
        self.monitor.command(time, command)

    def add_encoders(self, time: float, position: Array) -> list[SensorFinding]:
        """(j,) rad, m; what they complete."""
        if self._encoders and time <= self._encoders[-1][0]:
            self._refuse(f"encoders at {time:.4f} s: out of order or twice")
            return []
        self.monitor.readings.read_encoders(time, position)
        self._encoders = [*self._encoders[-1:], (time, position)]
        return self._complete()

    def add_pressures(
        self, time: float, chamber_a: Array, chamber_b: Array, supply: float
    ) -> list[SensorFinding]:
        """(j,) (j,) Pa, and the supply; what they complete."""
        self.monitor.readings.read_pressures(time, chamber_a, chamber_b, supply)
        self._pressures.append((time, chamber_a, chamber_b, supply))
        del self._pressures[:-WAITING_ROOM]
        return self._complete()

    def _complete(self) -> list[SensorFinding]:
        found: list[SensorFinding] = []
        while self._pressures and self._encoders and self._pressures[0][0] <= self._encoders[-1][0]:
            time, chamber_a, chamber_b, supply = self._pressures.pop(0)
            if not self._commanded or time < self._encoders[0][0]:
                continue
            position = self._encoder_at(time)
            try:
                found += self.monitor.add(Sample(time, position, chamber_a, chamber_b, supply))
                self.condition = self._heed
            except DataError as error:
                self._refuse(str(error))
                self.condition = Heed.GAP
                found += self.monitor.interrupted()
        return found

    def _encoder_at(self, time: float) -> Array:
        """On a straight line between two readings; NaN where they are far apart."""
        (before, first), (after, second) = self._encoders[0], self._encoders[-1]
        if after - before > LONGEST:
            return np.full_like(second, np.nan)
        if time == after or after == before:
            return second
        return first + (time - before) / (after - before) * (second - first)

    def _refuse(self, why: str) -> None:
        self.refused += 1
        self.last_refusal = why
