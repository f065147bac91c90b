"""From a bag and the column map of its topics to a log."""

from collections.abc import Sequence
from pathlib import Path

from crane_bags.clocks import NANOSECONDS
from crane_bags.fields import Place, read_fields
from crane_identification.data.column_map import ColumnMap
from crane_identification.data.log import Log
from crane_identification.data.mapped_log import Stream, mapped_log
from crane_model.errors import ConfigurationError
from crane_model.progress import Progress, silent


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
