"""A bag before the monitor, as it would have come on the machine."""

from enum import Enum
from pathlib import Path
from typing import NamedTuple

import numpy as np

from crane_model.array import Array
from crane_model.errors import ConfigurationError, DataError
from crane_model.model_file import Model
from crane_observer.monitor.blocks import LONGEST_SAMPLE_GAP, KnownFlow, Sample
from crane_observer.monitor.finding import SensorFinding
from crane_observer.monitor.monitor import SensorComparison, SensorsAlone
from crane_observer.monitor.tolerance import Added, Sums, Tolerance, of_block, summed, unlearnt
from crane_observer.recording import (
    AlignedEncoders,
    CommandReading,
    EncoderReading,
    HeardRecording,
    PressureReading,
)

WAITING_PRESSURES = 100  # readings, that wait for an encoder


class Heed(Enum):
    """Use of sensors in comparisons."""

    WAITING = "waits for encoders, pressures and valve commands"
    WATCHING = "compares all sensors"
    ALONE = "the model holds no hydraulics: each sensor is watched by itself, none is compared"
    UNLEARNT = (
        "no tolerance is given for valves that share a pump: each sensor is watched by itself, "
        "none is compared; learn a tolerance with check_sensors --learn"
    )
    GAP = "readings are missing: compares again as soon as they come"


class SensorWatch:
    """Takes readings of three topics as they come, and gives findings.

    Times are in seconds; arrays (j,) are in the order of the joints of the model.

    Parameters
    ----------
    model
        Identified model; without hydraulics every sensor is watched by itself.
    tolerance
        How far residuals go without a fault; by default a wide one is assumed. Of valves that share
        a pump none is assumed, and every sensor is watched by itself.

    Raises
    ------
    ConfigurationError
        There is a tolerance, but the model has no hydraulics.
    DataError
        The tolerance is that of other joints.
    """

    def __init__(self, model: Model, tolerance: Tolerance | None = None):
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
            if tolerance is None and physics.machine.hydraulics.load_sensing:
                self.monitor, self._heed = SensorsAlone(model), Heed.UNLEARNT
        self.condition = Heed.WAITING
        self.refused = 0  # samples
        self.last_refusal = ""
        latency = (
            model.machine.latency(model.joints) if model.machine else np.zeros(len(model.joints))
        )
        self._aligned = AlignedEncoders(latency)
        self._encoders: list[EncoderReading] = []
        self._read = -np.inf  # s, stamp of the newest
        self._pressures: list[PressureReading] = []
        self._commanded = self._heed is not Heed.WATCHING  # else commands are asked for

    def add_command(self, time: float, command: Array) -> None:
        """Take valve commands (j,) [-1..1], in force from `time` [s] on."""
        self._commanded = True
        self.monitor.command(time, command)

    def add_encoders(self, time: float, position: Array) -> list[SensorFinding]:
        """Take readings of the encoders.

        Parameters
        ----------
        time
            Their stamp [s].
        position
            Positions (j,) [rad, m].

        Returns
        -------
        list of SensorFinding
            What they brought to light.
        """
        if time <= self._read:
            self._refuse(f"encoders at {time:.4f} s: out of order or twice")
            return []
        self._read = time
        self.monitor.readings.read_encoders(time, position)
        self._encoders = [*self._encoders[-1:], self._aligned.at(time, position)]
        return self._complete()

    def add_pressures(
        self, time: float, chamber_a: Array, chamber_b: Array, supply: float
    ) -> list[SensorFinding]:
        """Take readings of the pressures.

        Parameters
        ----------
        time
            Their stamp [s].
        chamber_a, chamber_b
            Pressures (j,) [Pa].
        supply
            Supply pressure [Pa].

        Returns
        -------
        list of SensorFinding
            What they brought to light.
        """
        self.monitor.readings.read_pressures(time, chamber_a, chamber_b, supply)
        self._pressures.append(PressureReading(time, chamber_a, chamber_b, supply))
        del self._pressures[:-WAITING_PRESSURES]
        return self._complete()

    def _complete(self) -> list[SensorFinding]:
        """Make samples of encoders at the stamps of pressures."""
        found: list[SensorFinding] = []
        while self._pressures and self._encoders:
            if self._pressures[0].time > self._encoders[-1].time:
                break
            time, chamber_a, chamber_b, supply = self._pressures.pop(0)
            if not self._commanded or time < self._encoders[0].time:
                continue
            try:
                position = self._encoder_at(time)
                sample = Sample(time, position, chamber_a, chamber_b, supply)
                found += self.monitor.add(sample)
                self.condition = self._heed
            except DataError as error:
                self._refuse(str(error))
                self.condition = Heed.GAP
                found += self.monitor.interrupted()
        return found

    def _encoder_at(self, time: float) -> Array:
        """On a straight line between two readings; NaN where they are far apart."""
        (before, first), (after, second) = self._encoders[0], self._encoders[-1]
        if after - before > LONGEST_SAMPLE_GAP:
            return np.full_like(second, np.nan)
        if time == after or after == before:
            return second
        return first + (time - before) / (after - before) * (second - first)

    def _refuse(self, why: str) -> None:
        self.refused += 1
        self.last_refusal = why


class WatchedBag(NamedTuple):
    """Results of the monitor for a bag."""

    bag: Path
    joints: tuple[str, ...]
    findings: tuple[SensorFinding, ...]
    sums: Sums  # of the whole bag
    taken: Array  # (n, c) share of the tolerance, by channel and block
    refused: int
    why_not: str
    notes: tuple[str, ...] = ()  # what was repaired when the bag was read

    @property
    def largest(self) -> float:
        return float(self.taken.max(initial=0.0))


def watch(bag: Path, model: Model, tolerance: Tolerance | None) -> WatchedBag:
    """`DataError` names what the bag lacks."""
    return compare(HeardRecording.read(bag, model.joints), model, tolerance)


def compare(recording: HeardRecording, model: Model, tolerance: Tolerance | None) -> WatchedBag:
    """The same of what was read."""
    watched = SensorWatch(model, tolerance)
    monitor, times, taken = watched.monitor, list[float](), []
    blocks: list[Added] = []
    for reading in recording.readings():
        if isinstance(reading, CommandReading):
            watched.add_command(*reading)
            continue
        if isinstance(reading, EncoderReading):
            watched.add_encoders(*reading)
        else:
            watched.add_pressures(*reading)
        if (block := monitor.take_block()) is not None:
            blocks.append(of_block(block))
            times.append(block.time)
            taken.append(monitor.taken)
    if watched.condition in (Heed.ALONE, Heed.UNLEARNT):
        sums = Sums.zeros(0, 2 * len(model.joints) + 1)
    elif not blocks:
        why = watched.last_refusal or Heed.WAITING.value
        raise DataError(f"{recording.path}: nothing could be compared: {why}")
    else:
        sums = summed(times, blocks)
    return WatchedBag(
        recording.path, model.joints, tuple(monitor.findings), sums, np.array(taken),
        watched.refused, watched.last_refusal, recording.notes,
    )  # fmt: skip


def draw(seen: WatchedBag, file: Path) -> None:
    """Draw the share of its tolerance that each chamber takes over time, and the findings."""
    from matplotlib.figure import Figure  # a second to import

    figure = Figure(figsize=(9.0, 1.6 * (len(seen.joints) + 1)), layout="constrained")
    panels = figure.subplots(len(seen.joints) + 1, 1, sharex=True)
    for j, joint in enumerate(seen.joints):
        for side, name in enumerate("AB"):
            shares, label = seen.taken[:, 2 * j + side], f"against chamber {name}"
            panels[j].plot(seen.sums.time, shares, lw=0.8, label=label)
        panels[j].set_ylabel(joint)
    panels[-1].plot(seen.sums.time, seen.taken[:, -1], lw=0.8, color="C2")
    panels[-1].set_ylabel("supply")
    panels[-1].set_xlabel("time [s]")
    for panel in panels:
        panel.axhline(1.0, color="black", lw=0.6, ls="--")
        panel.set_yscale("log")
        panel.set_ylim(0.02, 50.0)
        for finding in seen.findings:
            panel.axvline(finding.onset, color="red", lw=0.8)
    panels[0].legend(loc="upper left", fontsize="small", ncols=2)
    found = (f"{one.sensor}: {one.kind} {one.how_much}".strip() for one in seen.findings)
    lines = [f"residuals relative to their tolerance, {seen.bag.name}", *found]
    panels[0].set_title("\n".join(lines), fontsize="medium")
    figure.savefig(file, dpi=120)
