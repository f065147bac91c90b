"""A bag as the observers hear it: readings in the order in which they would have come."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from crane_bags.clocks import NANOSECONDS
from crane_bags.driver_states import let_through
from crane_bags.namespaces import namespace_of
from crane_bags.reader import read_topics
from crane_bags.types import CYLINDER_PRESSURES, JOINT_STATES, VALVE_COMMAND, VALVE_OUTPUT
from crane_model.array import Array
from crane_model.errors import DataError

ENCODERS, PRESSURES, COMMAND = range(3)


@dataclass(frozen=True)
class HeardRecording:
    """Readings of j joints; times in seconds since the first of the pressures."""

    path: Path
    start: int  # ns
    encoder_time: Array  # (n,)
    encoders: Array  # (n, j) rad, m
    pressure_time: Array  # (m,)
    chamber_a: Array  # (m, j) Pa
    chamber_b: Array  # (m, j) Pa
    supply: Array  # (m,) Pa
    command_time: Array  # (k,)
    commands: Array  # (k, j) that reached the valves
    notes: tuple[str, ...] = ()  # what was mended when it was read

    @classmethod
    def read(cls, path: Path, joints: tuple[str, ...]) -> "HeardRecording":
        """`DataError` names the topic that is missing, or whose time goes back again and again, and
        what to record.
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
        used = [one for one in (pressures, commands, states) if one]
        for one in used:
            if one.set_back and one.set_back.spoils:
                raise DataError(
                    f"{path}: topic {one.topic}: {one.set_back}, so that {one.set_back.share:.1%} "
                    "of its messages are older than one before them; record with one clock"
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
            tuple(note for one in used for note in one.notes),
        )

    def events(self) -> Iterator[tuple[int, int]]:
        """ENCODERS, PRESSURES or COMMAND, and its row; of one stamp in this order."""
        times = (self.encoder_time, self.pressure_time, self.command_time)
        kinds = np.repeat(np.arange(3), [len(one) for one in times])
        rows = np.concatenate([np.arange(len(one)) for one in times])
        for i in np.lexsort((kinds, np.concatenate(times))):
            yield int(kinds[i]), int(rows[i])


def reached(time: Array, commands: Array, told: Array, through: np.ndarray) -> tuple[Array, Array]:
    """Commands (k, j) at time (k,) [s] as the valves had them, where the driver told (n,) [s]
    whether it let them through (n,): neutral from where it says no; before it says anything, as
    they are.
    """
    if not len(told):
        return time, commands
    every = np.concatenate([time, told])
    order = np.argsort(every, kind="stable")
    newest = np.searchsorted(time, every, side="right") - 1
    values = np.where((newest >= 0)[:, np.newaxis], commands[newest], 0.0)
    state = np.searchsorted(told, every, side="right") - 1
    closed = (state >= 0) & ~through[state]
    values[closed] = 0.0
    return every[order], values[order]
