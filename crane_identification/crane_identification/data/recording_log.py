"""From a recording of any kind to a log: a bag, a table, or a folder of tables."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from crane_bags.clocks import NANOSECONDS, SetBack
from crane_bags.fields import Place, read_fields
from crane_bags.reader import TopicData, namespace_of, read_topics
from crane_bags.types import (
    CYLINDER_PRESSURES,
    JOINT_REFERENCE,
    JOINT_STATES,
    VALVE_COMMAND,
    VALVE_OUTPUT,
    Topic,
)
from crane_identification.data.column_map import (
    COUNTS,
    TABLES,
    Cell,
    ColumnMap,
    JointSources,
    Source,
)
from crane_identification.data.log import Log, Signal
from crane_model.errors import ConfigurationError, DataError
from crane_model.progress_bar import Progress, silent

SLEW = "slew"
INTERPOLATED_GAP_S = 0.1  # s between two numbers that are interpolated
ROUNDING_MARGIN_S = 1e-6  # s, by which times of 0.1 s may be rounded


def tables_in(folder: Path) -> list[Path]:
    """The tables of a folder, in the order of their names, where numbers count as numbers."""
    if not folder.is_dir():
        return []
    tables = [path for path in folder.iterdir() if path.suffix.lower() in TABLES]
    return sorted(tables, key=lambda path: _natural(path.name))


def _natural(name: str) -> list[tuple[int, str]]:
    return [(int(part) if part.isdigit() else 0, part) for part in re.split(r"(\d+)", name)]


def read_bag(
    path: Path | str,
    joints: Sequence[str],
    progress: Progress = silent,
    namespace: str | None = None,
) -> Log:
    """Read a bag with the topics of the suite.

    Without /valve_command, as in the bag of a driver that only listens, commands are those of
    /valve_output.

    Parameters
    ----------
    path : Path or str
        Bag (folder), in either storage.
    joints : sequence of str
        Joints to read, in the order of the columns of the log.
    progress : Progress
        Receiver of the progress.
    namespace : str, optional
        Namespace of the topics; None: the one that the bag holds.

    Returns
    -------
    Log
        Positions, and chamber pressures or else the effort of /joint_states as force; `missing`
        names topics that the bag lacks.

    Raises
    ------
    DataError
        If the bag cannot be read, or lacks positions, or both pressures and forces.
    """
    namespace = namespace_of(path) if namespace is None else namespace
    joint_states = JOINT_STATES.within(namespace)
    may_lack = tuple(
        topic.within(namespace) for topic in (CYLINDER_PRESSURES, VALVE_COMMAND, JOINT_REFERENCE)
    )
    cylinder_pressures, valve_command, joint_reference = may_lack
    valve_output = VALVE_OUTPUT.within(namespace)
    topics = read_topics(path, (joint_states,), (*may_lack, valve_output), progress)
    if valve_command.name not in topics:
        valve_command = valve_output
    states = topics[joint_states.name].select(joints)
    pressures = topics.get(cylinder_pressures.name)
    pressures = pressures and pressures.select(joints)
    if pressures is None and np.isnan(states.fields["effort"]).all():
        raise DataError(
            f"{path}: no topic {cylinder_pressures.name}, and {joint_states.name} holds no effort "
            f"(generalized force) of {', '.join(joints)} in its place; record one of them"
        )
    command = _selected(topics, valve_command, joints)
    reference = _selected(topics, joint_reference, joints)
    slew = None if SLEW in joints else _selected(topics, joint_states, [SLEW])
    slewed = None if SLEW in joints else _selected(topics, valve_command, [SLEW])
    start = int(states.stamp[0])

    def signal(data: TopicData, field: str) -> Signal:
        time, received = (data.stamp - start) / NANOSECONDS, (data.log_time - start) / NANOSECONDS
        known = data.stamped_by == "header"  # else the stamps are the log times
        by_recorder = received if known else None
        return Signal(time, data.fields[field], data.topic, by_recorder, data.set_back)

    def signal_if_any(data: TopicData | None, field: str) -> Signal | None:
        if data is None or np.isnan(data.fields[field]).all():
            return None
        return signal(data, field)

    effort = () if pressures else (f"the effort of {joint_states.name} is taken as the force",)
    used = [data for data in (states, pressures, command, reference) if data]
    return Log(
        source=str(path),
        joints=tuple(joints),
        start=start,
        position=signal(states, "position"),
        velocity=signal_if_any(states, "velocity"),
        force=None if pressures else signal(states, "effort"),
        pressure_a=signal(pressures, "chamber_a") if pressures else None,
        pressure_b=signal(pressures, "chamber_b") if pressures else None,
        supply_pressure=signal_if_any(pressures, "supply"),
        tank_pressure=signal_if_any(pressures, "tank"),
        slew_position=_first_column(signal_if_any(slew, "position")),
        slew_command=_first_column(signal_if_any(slewed, "command")),
        command=signal_if_any(command, "command"),
        reference_position=signal_if_any(reference, "position"),
        reference_velocity=signal_if_any(reference, "velocity"),
        reference_acceleration=signal_if_any(reference, "acceleration"),
        missing=tuple(
            topic.name
            for topic, data in zip(may_lack, (pressures, command, reference), strict=True)
            if data is None
        ),
        unstamped=tuple(data.topic for data in used if data.stamped_by == "log time"),
        notes=(*dict.fromkeys(note for data in used for note in data.notes), *effort),
    )


def _selected(
    topics: Mapping[str, TopicData], topic: Topic, names: Sequence[str]
) -> TopicData | None:
    """The columns `names` of an optional topic, or None where it does not name them all."""
    data = topics.get(topic.name)
    return data.select(names) if data and set(names) <= set(data.names) else None


def _first_column(signal: Signal | None) -> Signal | None:
    return signal and replace(signal, value=signal.value[:, 0])


# From the numbers of a recording and its column map to a log.


@dataclass(frozen=True)
class Stream:
    """Numbers that stand in one row, or message, and so are of one time."""

    start: int  # ns, first stamp
    time: np.ndarray  # (n,) s since `start`, strictly increasing
    numbers: Mapping[Cell, np.ndarray]  # (n,) each
    received: np.ndarray | None = None  # (n,) s since `start`, on the clock of the recorder
    set_back: SetBack | None = None


class _Series(NamedTuple):
    """One quantity in SI units, at the times of its stream."""

    stream: Stream
    value: np.ndarray  # (n,)
    label: str


def mapped_log(
    path: Path,
    column_map: ColumnMap,
    joints: Sequence[str],
    streams: Mapping[str, Stream],
    notes: Sequence[str] = (),
    unstamped: Sequence[str] = (),
) -> Log:
    """The signals of `joints`, out of the streams that `Reading.stream` names.

    What one signal needs of several streams is interpolated to the times of the first.
    """
    of_joint = column_map.of(joints, path)
    shared = column_map.shared()
    start = streams[of_joint[0].position.readings[0].stream].start

    def signal(series: Sequence[_Series]) -> Signal:
        base = series[0].stream
        value = np.column_stack([_at(base, part) for part in series])
        origin = ", ".join(part.label for part in series)
        kind = "" if column_map.of_topics else "column "
        shift = (base.start - start) / NANOSECONDS
        received = None if base.received is None else base.received + shift
        columns = tuple(f"{kind}{part.label}" for part in series)
        return Signal(base.time + shift, value, f"{kind}{origin}", received, base.set_back, columns)

    signals: dict[str, Any] = {}
    for quantity in of_joint[0].given():
        signals[quantity] = signal(
            [_series(streams, sources.given()[quantity]) for sources in of_joint]
        )
    if "force" not in signals and any(sources.cylinder for sources in of_joint):
        signals["force"] = signal([_cylinder_force(streams, sources) for sources in of_joint])
    for quantity, source in shared.items():
        column = signal([_series(streams, source)])
        signals[quantity] = replace(column, value=column.value[:, 0])
    raw = _uncalibrated(joints, of_joint, shared)
    counts = (f"{', '.join(raw)}: in counts, and so is what follows from them",) if raw else ()
    return Log(
        source=str(path),
        joints=tuple(joints),
        start=start,
        notes=(*notes, *counts),
        uncalibrated=raw,
        unstamped=tuple(unstamped),
        **signals,
    )


def _series(streams: Mapping[str, Stream], source: Source) -> _Series:
    parts = [
        _Series(
            streams[reading.stream],
            reading.in_si(streams[reading.stream].numbers[reading.cell]),
            reading.label,
        )
        for reading in source.readings
    ]
    base = parts[0].stream
    value = source.combined([_at(base, part) for part in parts])
    return _Series(base, value, source.label)


def _cylinder_force(streams: Mapping[str, Stream], joint: JointSources) -> _Series:
    """The force of a joint that has a cylinder, or a force of its own."""
    if joint.cylinder is None:
        assert joint.force is not None  # the map gives forces for all joints or for none
        return _series(streams, joint.force)
    given = [source and _series(streams, source) for source in (joint.pressure_a, joint.pressure_b)]
    chambers = [series for series in given if series]
    base = chambers[0].stream
    force = joint.cylinder.force(*(_at(base, series) if series else 0.0 for series in given))
    return _Series(base, force, ", ".join(chamber.label for chamber in chambers))


def _at(base: Stream, series: _Series) -> np.ndarray:
    """(n,) at the times of `base`, NaN where numbers are too far apart."""
    if series.stream is base:
        return series.value
    known = np.isfinite(series.value)
    time = series.stream.time[known] + (series.stream.start - base.start) / NANOSECONDS
    if not len(time):
        return np.full(len(base.time), np.nan)
    value = np.interp(base.time, time, series.value[known], left=np.nan, right=np.nan)
    after = np.searchsorted(time, base.time).clip(1, max(len(time) - 1, 1))
    apart = np.diff(time, append=np.inf)[after - 1] > INTERPOLATED_GAP_S + ROUNDING_MARGIN_S
    value[apart & ~np.isin(base.time, time)] = np.nan
    return value


def _uncalibrated(
    joints: Sequence[str], of_joint: Sequence[JointSources], shared: Mapping[str, Source]
) -> tuple[str, ...]:
    of_joints = [
        (f"{name} of {joint}", source)
        for joint, sources in zip(joints, of_joint, strict=True)
        for name, source in sources.given().items()
    ]
    return tuple(
        f"{name.replace('_', ' ')} ({source.label})"
        for name, source in (*of_joints, *shared.items())
        if source.quantity == COUNTS
    )


# From a bag and the column map of its topics to a log.


def read_mapped_bag(
    path: Path | str, column_map: ColumnMap, joints: Sequence[str], progress: Progress = silent
) -> Log:
    """The signals of `joints` in a bag whose topics the map names, of whatever type.

    `DataError` and `ConfigurationError` name bag, topic, what there is instead, and the remedy.
    """
    path = Path(path)
    if not column_map.of_topics:
        raise ConfigurationError(
            f"{path}: the column map is for tables: it names columns; name topics, or give a table"
        )
    cells = column_map.cells(joints, path)
    wanted = {topic: [Place(*cell) for cell in topic_cells] for topic, topic_cells in cells.items()}
    found = read_fields(path, wanted, column_map.types, progress)
    streams = {}
    for topic, data in found.items():
        start, known = int(data.stamp[0]), data.stamped_by == "header"
        received = (data.log_time - start) / NANOSECONDS if known else None
        numbers = {cell: data.fields[str(Place(*cell))] for cell in cells[topic]}
        time = (data.stamp - start) / NANOSECONDS
        streams[topic] = Stream(start, time, numbers, received, data.set_back)
    notes = list(dict.fromkeys(note for data in found.values() for note in data.notes))
    unstamped = [topic for topic, data in found.items() if data.stamped_by == "log time"]
    return mapped_log(path, column_map, joints, streams, notes, unstamped)


def read_recording(
    path: Path,
    joints: Sequence[str],
    columns: ColumnMap | None,
    progress: Progress = silent,
    namespace: str | None = None,
) -> Log:
    """Read a recording of any kind: a bag, a table, or a folder of tables.

    Parameters
    ----------
    path : Path
        Bag (folder), table (.csv, .tsv, .txt, .parquet, .mat) or folder of tables.
    joints : sequence of str
        Joints to read, in the order of the columns of the log.
    columns : ColumnMap or None
        Map of columns or topics to quantities; None: a bag with the topics of the suite.
    progress : Progress
        Receiver of the progress.
    namespace : str, optional
        Namespace of the topics of the suite; None: the one that the bag holds.

    Returns
    -------
    Log
        The signals of `joints`.

    Raises
    ------
    DataError, ConfigurationError
        If the recording cannot be read, or does not fit the map.
    """
    if columns is not None and namespace is not None:
        raise ConfigurationError(
            f"--namespace {namespace}: is for the topics of the suite, and a column map names its "
            "own; leave out --namespace or --columns"
        )
    bag = (path / "metadata.yaml").exists()
    if path.suffix.lower() in TABLES or (not bag and tables_in(path)):
        if columns is None:
            raise ConfigurationError(
                f"{path}: a table needs a column map that says which column holds what; "
                "name it with --columns"
            )
        from crane_identification.data.table_log import read_table  # large, for tables alone

        return read_table(path, columns, joints)
    if columns is None:
        return read_bag(path, joints, progress, namespace)
    return read_mapped_bag(path, columns, joints, progress)
