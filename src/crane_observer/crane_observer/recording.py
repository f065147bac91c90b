"""A bag as the observers hear it: readings in the order in which they would have come."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple, TypeAlias

import numpy as np

from crane_bags.clocks import NANOSECONDS
from crane_bags.reader import let_through, namespace_of, read_topics
from crane_bags.types import CYLINDER_PRESSURES, JOINT_STATES, VALVE_COMMAND, VALVE_OUTPUT
from crane_model.array import Array
from crane_model.errors import DataError
from crane_model.sensors import at_one_time


class EncoderReading(NamedTuple):
    """Positions of j joints at one time."""

    time: float  # s
    position: Array  # (j,) rad, m


class PressureReading(NamedTuple):
    """Pressures of j joints at one time."""

    time: float  # s
    chamber_a: Array  # (j,) Pa
    chamber_b: Array  # (j,) Pa
    supply: float  # Pa


class CommandReading(NamedTuple):
    """Commands of j valves, in force from one time on."""

    time: float  # s
    command: Array  # (j,) -1..1


Reading: TypeAlias = EncoderReading | PressureReading | CommandReading


class AlignedEncoders:
    """Readings of j joints as they come, to positions at one time.

    Parameters
    ----------
    latency
        By which the readings are older than their stamps (j,), in the unit of these.
    """

    def __init__(self, latency: Array):
        self._latency, self._wait = latency, float(np.ptp(latency))
        self._held: list[EncoderReading] = []

    def at(self, time: float, position: Array) -> EncoderReading:
        """Return the positions (j,) that are known with a reading of `time`, and their time."""
        if not self._latency.any():
            return EncoderReading(time, position)
        if self._held and time <= self._held[-1].time:
            self._held.clear()
        while len(self._held) > 1 and self._held[1].time <= time - self._wait:
            self._held.pop(0)
        self._held.append(EncoderReading(time, position))
        times, positions = zip(*self._held, strict=True)
        at, shown = at_one_time(np.array(times), np.array(positions), self._latency)
        return EncoderReading(float(at[-1]), shown[-1])


@dataclass(frozen=True)
class HeardRecording:
    """Readings of j joints in a bag; times in seconds since the first reading of pressures.

    Parameters
    ----------
    path
        The bag.
    start
        Stamp of the first reading of pressures [ns].
    encoder_time, encoders
        Times (n,) [s] and positions (n, j) [rad, m]; without rows if the bag has no joint states.
    pressure_time, chamber_a, chamber_b, supply
        Times (m,) [s], pressures of the chambers (m, j) and of the supply (m,) [Pa].
    command_time, commands
        Times (k,) [s] and commands (k, j) [-1..1] that reached the valves.
    notes
        What was repaired when the bag was read.
    """

    path: Path
    start: int
    encoder_time: Array
    encoders: Array
    pressure_time: Array
    chamber_a: Array
    chamber_b: Array
    supply: Array
    command_time: Array
    commands: Array
    notes: tuple[str, ...] = ()

    @classmethod
    def read(cls, path: Path, joints: tuple[str, ...]) -> "HeardRecording":
        """Read the readings of some joints from a bag.

        Parameters
        ----------
        path
            Folder or file of the bag.
        joints
            Names of the joints, in the order of the columns.

        Returns
        -------
        HeardRecording
            The readings.

        Raises
        ------
        DataError
            A topic is missing, or its time goes back again and again; says what to record.
        """
        namespace = namespace_of(path)
        states_, pressures_, asked, sent = (
            topic.within(namespace)
            for topic in (JOINT_STATES, CYLINDER_PRESSURES, VALVE_COMMAND, VALVE_OUTPUT)
        )
        found = read_topics(path, (), (states_, pressures_, asked, sent))
        output = sent if sent.name in found else asked  # what the driver did not tell was asked
        for topic in (pressures_, output):
            if topic.name not in found:
                raise DataError(
                    f"{path}: holds no {topic.name}, without which flow is not known; record it"
                )
        pressures = found[pressures_.name].select(joints)
        commands = found[output.name].select(joints)
        states = found[states_.name].select(joints) if states_.name in found else None
        used = [data for data in (pressures, commands, states) if data]
        for data in used:
            if (back := data.set_back) and back.spoils:
                raise DataError(
                    f"{path}: topic {data.topic}: {back}, so that {back.share:.1%} of its "
                    "messages are older than one before them; record with one clock"
                )
        start = int(pressures.stamp[0])

        def seconds(stamp: np.ndarray) -> Array:
            return (stamp - start) / NANOSECONDS

        supply = pressures.fields.get("supply", np.full(len(pressures.stamp), np.nan))
        command_time, reaching = seconds(commands.stamp), commands.fields["command"]
        if output is asked:
            told, through = let_through(path, namespace)
            command_time, reaching = reached(command_time, reaching, seconds(told), through)
        return cls(
            path,
            start,
            np.zeros(0) if states is None else seconds(states.stamp),
            np.zeros((0, len(joints))) if states is None else states.fields["position"],
            seconds(pressures.stamp),
            pressures.fields["chamber_a"],
            pressures.fields["chamber_b"],
            supply,
            command_time,
            reaching,
            tuple(note for data in used for note in data.notes),
        )

    def readings(self) -> Iterator[Reading]:
        """Yield all readings by their stamps: of one stamp encoders, pressures, then commands.

        Yields
        ------
        EncoderReading, PressureReading or CommandReading
            One reading.
        """
        times = (self.encoder_time, self.pressure_time, self.command_time)
        kinds = np.repeat(np.arange(3), [len(stamps) for stamps in times])
        rows = np.concatenate([np.arange(len(stamps)) for stamps in times])
        for i in np.lexsort((kinds, np.concatenate(times))):
            row = int(rows[i])
            time = float(times[kinds[i]][row])
            if kinds[i] == 0:
                yield EncoderReading(time, self.encoders[row])
            elif kinds[i] == 1:
                pressures = self.chamber_a[row], self.chamber_b[row], float(self.supply[row])
                yield PressureReading(time, *pressures)
            else:
                yield CommandReading(time, self.commands[row])


def reached(time: Array, commands: Array, told: Array, through: np.ndarray) -> tuple[Array, Array]:
    """Commands (k, j) at time (k,) [s] as the valves had them, where the driver told (n,) [s]
    whether it let them through (n,): neutral from where it says no; before it says anything, as
    they are.
    """
    if not len(told):
        return time, commands
    both = np.concatenate([time, told])
    order = np.argsort(both, kind="stable")
    newest = np.searchsorted(time, both, side="right") - 1
    values = np.where((newest >= 0)[:, np.newaxis], commands[newest], 0.0)
    state = np.searchsorted(told, both, side="right") - 1
    closed = (state >= 0) & ~through[state]
    values[closed] = 0.0
    return both[order], values[order]
