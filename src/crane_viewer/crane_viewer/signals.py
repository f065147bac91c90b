"""Which sample becomes which line: measured, asked for, commanded, predicted."""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from crane_bags.decoding import Table
from crane_bags.types import (
    CYLINDER_PRESSURES,
    GENERALIZED_FORCES,
    JOINT_REFERENCE,
    JOINT_STATES,
    VALVE_COMMAND,
    Topic,
)
from crane_viewer import paths

MEGAPASCAL = 1e6  # Pa


class PlottedLines(NamedTuple):
    """What is plotted at one place: stamps (n,) [ns], and (n, k) values of its k lines."""

    path: str
    stamps: np.ndarray
    values: np.ndarray


def signals(topic: Topic, table: Table, joints: tuple[str, ...]) -> Iterator[PlottedLines]:
    """The lines of messages of a topic; nothing of what is not known or of no joint of `joints`."""
    known = [(k, name) for k, name in enumerate(table.names) if name in joints]
    match topic.relative.rpartition("/")[2]:
        case JOINT_STATES.relative:
            for k, joint in known:
                yield from _present(paths.position(joint), table, table.fields["position"][:, k])
                yield from _present(
                    paths.measured_force(joint), table, table.fields["effort"][:, k]
                )
        case JOINT_REFERENCE.relative:
            for k, joint in known:
                yield from _present(paths.reference(joint), table, table.fields["position"][:, k])
        case CYLINDER_PRESSURES.relative:
            for k, joint in known:
                chambers = [table.fields[f"chamber_{one}"][:, k] for one in "ab"]
                values = np.stack(chambers, axis=1) / MEGAPASCAL
                yield from _present(paths.pressures(joint), table, values)
        case VALVE_COMMAND.relative:
            commands = np.zeros((len(table.stamp), len(joints)))  # what is not named is neutral
            for k, joint in known:
                commands[:, joints.index(joint)] = np.nan_to_num(table.fields["command"][:, k])
            yield from _present(paths.COMMANDS, table, commands)
        case GENERALIZED_FORCES.relative:
            for k, joint in known:
                yield from _present(
                    paths.predicted_force(joint), table, table.fields["predicted"][:, k]
                )


def _present(path: str, table: Table, values: np.ndarray) -> Iterator[PlottedLines]:
    """The rows that hold a number."""
    values = values.reshape(len(table.stamp), -1)
    rows = np.isfinite(values).any(axis=1)
    if rows.any():
        yield PlottedLines(path, table.stamp[rows], values[rows])
