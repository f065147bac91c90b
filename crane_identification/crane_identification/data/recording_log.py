"""From a recording of any kind to a log: a bag, a table, or a folder of tables."""

from collections.abc import Sequence
from pathlib import Path

from crane_identification.data.bag_log import read_bag
from crane_identification.data.column_map import ColumnMap
from crane_identification.data.log import Log
from crane_identification.data.mapped_log import read_mapped_bag
from crane_identification.data.table_files import TABLES, tables_in
from crane_model.errors import ConfigurationError
from crane_model.progress_bar import Progress, silent


def read_recording(
    path: Path,
    joints: Sequence[str],
    columns: ColumnMap | None,
    progress: Progress = silent,
    namespace: str | None = None,
) -> Log:
    """The signals of `joints`; of a bag without `columns` those of the suite's topics, in
    `namespace` (None: the one that the bag holds).

    `DataError` and `ConfigurationError` name recording, topic or column, and remedy.
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
