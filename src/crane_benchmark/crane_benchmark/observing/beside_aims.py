"""What was measured beside its aims: shown, written, and an error where one is missed."""

from collections.abc import Sequence
from pathlib import Path

from rich.table import Table

from crane_benchmark.measured import MeasuredRow, write
from crane_identification.report import terminal
from crane_model.errors import CraneError

WIDTH = 140  # of a table that goes into a file


def tell(
    rows: Sequence[MeasuredRow],
    columns: Sequence[str],
    command: str,
    out: Path | None,
    misses: Sequence[str],
) -> None:
    """Print the rows, and write them to `out` as what `command` measured; `CraneError` names the
    `misses`.
    """
    table = Table(*columns)
    for row in rows:
        table.add_row(*row.shown)
    terminal.console(WIDTH).print(table)
    if out is not None:
        write(out, command, rows, columns)
    if misses:
        raise CraneError("\n  ".join(("aims are missed:", *misses)))
