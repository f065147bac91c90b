"""From the numbers of a recording and its column map to a log."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from crane_bags.clocks import NANOSECONDS, SetBack
from crane_bags.fields import Place, read_fields
from crane_identification.data.column_map import COUNTS, Cell, ColumnMap, JointSources, Source
from crane_identification.data.log import Log, Signal
from crane_model.errors import ConfigurationError
from crane_model.progress_bar import Progress, silent

LARGEST_GAP = 0.1  # s between two numbers that are interpolated
MARGIN = 1e-6  # s, by which times of 0.1 s may be rounded


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
        value = np.column_stack([_at(base, one) for one in series])
        origin = ", ".join(one.label for one in series)
        kind = "" if column_map.of_topics else "column "
        shift = (base.start - start) / NANOSECONDS
        received = None if base.received is None else base.received + shift
        columns = tuple(f"{kind}{one.label}" for one in series)
        return Signal(base.time + shift, value, f"{kind}{origin}", received, base.set_back, columns)

    signals: dict[str, Any] = {}
    for quantity in of_joint[0].given():
        signals[quantity] = signal([_series(streams, one.given()[quantity]) for one in of_joint])
    if "force" not in signals and any(one.cylinder for one in of_joint):
        signals["force"] = signal([_cylinder_force(streams, one) for one in of_joint])
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
        _Series(streams[one.stream], one.in_si(streams[one.stream].numbers[one.cell]), one.label)
        for one in source.readings
    ]
    base = parts[0].stream
    value = source.combined([_at(base, part) for part in parts])
    return _Series(base, value, source.label)


def _cylinder_force(streams: Mapping[str, Stream], joint: JointSources) -> _Series:
    """The force of a joint that has a cylinder, or a force of its own."""
    if joint.cylinder is None:
        assert joint.force is not None  # the map gives forces for all joints or for none
        return _series(streams, joint.force)
    given = [one and _series(streams, one) for one in (joint.pressure_a, joint.pressure_b)]
    chambers = [one for one in given if one]
    base = chambers[0].stream
    force = joint.cylinder.force(*(_at(base, one) if one else 0.0 for one in given))
    return _Series(base, force, ", ".join(one.label for one in chambers))


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
    apart = np.diff(time, append=np.inf)[after - 1] > LARGEST_GAP + MARGIN
    value[apart & ~np.isin(base.time, time)] = np.nan
    return value


def _uncalibrated(
    joints: Sequence[str], of_joint: Sequence[JointSources], shared: Mapping[str, Source]
) -> tuple[str, ...]:
    of_joints = [
        (f"{name} of {joint}", source)
        for joint, one in zip(joints, of_joint, strict=True)
        for name, source in one.given().items()
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
    wanted = {topic: [Place(*cell) for cell in one] for topic, one in cells.items()}
    found = read_fields(path, wanted, column_map.types, progress)
    streams = {}
    for topic, data in found.items():
        start, known = int(data.stamp[0]), data.stamped_by == "header"
        received = (data.log_time - start) / NANOSECONDS if known else None
        numbers = {cell: data.fields[str(Place(*cell))] for cell in cells[topic]}
        time = (data.stamp - start) / NANOSECONDS
        streams[topic] = Stream(start, time, numbers, received, data.set_back)
    notes = [note for data in found.values() for note in data.notes]
    unstamped = [topic for topic, data in found.items() if data.stamped_by == "log time"]
    return mapped_log(path, column_map, joints, streams, notes, unstamped)
