"""Measured figures as data: each command that measures writes a file, the manual's tables show it.

`python -m crane_benchmark.measured OUT COMMAND ...` measures how long any other command takes.
"""

import argparse
import re
import subprocess
import sys
import time
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path

from crane_model.errors import CraneError
from crane_model.result_file import ResultFile, ResultPart

FILE_WIDTH = 140  # characters of a table that goes into a file
NO_BREAK = "\u00a0"
RESULT_COLUMNS = ("quantity", "target", "measured")
PERCENT_SIGN = re.compile(r"(?<=\d)%")
BEFORE_UNIT = re.compile(r"(?<=\d) (?=[%σ]|(?:µs|ms|s|mrad|mm|rad|bar|times)\b)")


class MeasuredRow(ResultPart):
    r"""A row of a table.

    >>> MeasuredRow(cells=["error", "", "{error:.1%}"], values={"error": 0.0123}).shown
    ['error', '', '1.2\xa0%']
    """

    cells: list[str]
    """One for each column; `{name:.1f}` is a value, in the format that Python has for it."""
    values: dict[str, float] = {}
    """Measured values by name [unit of its cell]."""

    @property
    def shown(self) -> list[str]:
        plain = (PERCENT_SIGN.sub(" %", cell.format(**self.values)) for cell in self.cells)
        return [BEFORE_UNIT.sub(NO_BREAK, cell) for cell in plain]


class MeasuredFigures(ResultFile):
    """Measured figures of a command, as a table."""

    command: str
    """That measured it."""
    date: str
    """When, UTC: 2026-11-22 14:05."""
    commit: str
    """Commit of the measured source; empty if it was not a clone."""
    columns: list[str]
    """Headings of the cells of all rows."""
    rows: list[MeasuredRow]
    """In their order."""

    def value(self, name: str) -> float:
        """The value of that name, which one row has."""
        (value,) = (row.values[name] for row in self.rows if name in row.values)
        return value


def of_joints(
    name: str, what: str, values: Mapping[str, float], shown: str, target: str = ""
) -> MeasuredRow:
    """A value for each joint, `name`_JOINT, `shown` in that format."""
    return MeasuredRow(
        cells=[what, target, ", ".join(f"{{{name}_{joint}:{shown}}}" for joint in values)],
        values={f"{name}_{joint}": value for joint, value in values.items()},
    )


def write(
    path: Path, command: str, rows: Sequence[MeasuredRow], columns: Sequence[str] = RESULT_COLUMNS
) -> MeasuredFigures:
    """Write what `command` has measured just now to the file `path`, and return it."""
    found = MeasuredFigures(
        command=command,
        date=datetime.now(UTC).strftime("%Y-%m-%d %H:%M"),
        commit=_commit(),
        columns=list(columns),
        rows=list(rows),
    )
    path.parent.mkdir(parents=True, exist_ok=True)
    found.write(path)
    return found


def _commit() -> str:
    """Commit of the clone that this file is in."""
    command = ["git", "-C", str(Path(__file__).resolve().parent), "describe", "--always", "--dirty"]
    try:
        done = subprocess.run(command, capture_output=True, text=True)
    except FileNotFoundError:  # no git
        return ""
    return done.stdout.strip() if done.returncode == 0 else ""


def tell(
    rows: Sequence[MeasuredRow],
    columns: Sequence[str],
    command: str,
    out: Path | None,
    misses: Sequence[str],
) -> None:
    """Print the rows and write them to `out`, if given; `CraneError` names the `misses`."""
    # large, and only here: whoever just writes figures, as the demo, needs neither
    from rich.markup import escape
    from rich.table import Table

    from crane_identification.report import terminal

    table = Table(*columns)
    for row in rows:
        table.add_row(*map(escape, row.shown))  # units in brackets are no styles
    terminal.console(FILE_WIDTH).print(table)
    if out is not None:
        write(out, command, rows, columns)
    if misses:
        raise CraneError("\n  ".join(("aims are missed:", *misses)))


def main(argv: Sequence[str] | None = None) -> int:
    """Run a command, and write how long it took if it ends well."""
    parser = argparse.ArgumentParser(prog="measured", description=main.__doc__)
    parser.add_argument("out", type=Path, help="file for the results (JSON)")
    parser.add_argument("command", nargs=argparse.REMAINDER)
    arguments = parser.parse_args(argv)
    begin = time.monotonic()
    status = subprocess.run(arguments.command).returncode
    if status == 0:
        words = " ".join(arguments.command)
        seconds = time.monotonic() - begin
        write(arguments.out, words, [MeasuredRow(cells=[f"`{words}`", "", "{seconds:.0f} s"],
                                         values={"seconds": seconds})])  # fmt: skip
    return status


if __name__ == "__main__":
    sys.exit(main())
