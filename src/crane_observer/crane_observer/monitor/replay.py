"""A bag before the monitor, as it would have come on the machine."""

from enum import Enum
from pathlib import Path
from typing import NamedTuple

import numpy as np

from crane_model.array import Array
from crane_model.errors import ConfigurationError, DataError
from crane_model.model_file import Model
from crane_observer.monitor.blocks import LONGEST, KnownFlow, Sample
from crane_observer.monitor.finding import SensorFinding
from crane_observer.monitor.history import TERMS, Added, Sums, of_block, summed
from crane_observer.monitor.monitor import SensorComparison, SensorsAlone
from crane_observer.monitor.tolerance import Tolerance, unlearnt
from crane_observer.recording import COMMAND, ENCODERS, HeardRecording

# From the readings of three topics to samples: encoders at the stamps of pressures.

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


class WatchedBag(NamedTuple):
    """What came out."""

    bag: Path
    joints: tuple[str, ...]
    findings: tuple[SensorFinding, ...]
    sums: Sums  # of the whole bag
    taken: Array  # (n, c) share of the tolerance, by channel and block
    refused: int
    why_not: str
    notes: tuple[str, ...] = ()  # what was mended when the bag was read

    @property
    def largest(self) -> float:
        """Share of the tolerance that was taken at most."""
        return float(self.taken.max(initial=0.0))


def watch(bag: Path, model: Model, tolerance: Tolerance | None) -> WatchedBag:
    """`DataError` names what the bag lacks."""
    return compare(HeardRecording.read(bag, model.joints), model, tolerance)


def compare(recording: HeardRecording, model: Model, tolerance: Tolerance | None) -> WatchedBag:
    """The same of what was read."""
    watched = SensorWatch(model, tolerance)
    monitor, taken = watched.monitor, []
    blocks: list[Added] = []
    for kind, row in recording.events():
        if kind == COMMAND:
            watched.add_command(float(recording.command_time[row]), recording.commands[row])
            continue
        if kind == ENCODERS:
            watched.add_encoders(float(recording.encoder_time[row]), recording.encoders[row])
        else:
            watched.add_pressures(
                float(recording.pressure_time[row]),
                recording.chamber_a[row],
                recording.chamber_b[row],
                float(recording.supply[row]),
            )
        if (block := monitor.take_block()) is not None:
            blocks.append(of_block(block))
            taken.append((block.time, monitor.taken))
    if model.hydraulics is None and watched.condition is Heed.ALONE:
        nothing = np.zeros((0, 2 * len(model.joints) + 1))
        sums = Sums(np.zeros(0), *(nothing,) * 5, np.zeros((*nothing.shape, TERMS)))
    elif not blocks:
        why = watched.last_refusal or Heed.WAITING.value
        raise DataError(f"{recording.path}: nothing could be compared: {why}")
    else:
        sums = summed([time for time, _ in taken], blocks)
    return WatchedBag(
        bag=recording.path,
        joints=model.joints,
        findings=tuple(monitor.findings),
        sums=sums,
        taken=np.array([shares for _, shares in taken]),
        refused=watched.refused,
        why_not=watched.last_refusal,
        notes=recording.notes,
    )
