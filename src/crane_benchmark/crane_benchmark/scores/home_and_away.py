"""Rates of sets of cases side by side: at home, away.

    python -m crane_benchmark.scores.home_and_away \\
        home=ROUND/home/figures.json away=ROUND/away/figures.json

A set is named as you like; its figures are those that the benchmark leaves beside its results, in
the folder of a round.
"""

import argparse
import re
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path

from crane_benchmark.measured import COLUMNS, MeasuredFigures, MeasuredRow
from crane_benchmark.observing.beside_aims import tell
from crane_benchmark.scores.judgement import OURS
from crane_benchmark.scores.published import NO_CASE
from crane_model import cli
from crane_model.errors import ConfigurationError, DataError

VALUE = re.compile(r"\{(\w+)")  # of a cell, where it is to stand


def side_by_side(sets: Mapping[str, MeasuredFigures]) -> list[MeasuredRow]:
    """What `diagnose` reached in each of the sets, row by row of the first one.

    `DataError` where a set was not scored by the benchmark.
    """
    for name, figures in sets.items():
        if OURS not in figures.columns:
            raise DataError(
                f"set '{name}': its figures have the columns {', '.join(figures.columns)}, not "
                f"{OURS}; give a figures.json that the benchmark has written"
            )
    first, *_ = sets.values()
    by_name = [{row.cells[0]: row for row in figures.rows} for figures in sets.values()]
    rows = []
    for what in (row.cells[0] for row in first.rows):
        cells = [what]
        values: dict[str, float] = {}
        for place, (figures, known) in enumerate(zip(sets.values(), by_name, strict=True)):
            if what not in known:
                cells += ["", NO_CASE]
                continue
            own = known[what]
            cells.append(own.cells[1])
            cells.append(VALUE.sub(rf"{{of{place}_\1", own.cells[figures.columns.index(OURS)]))
            values |= {f"of{place}_{name}": value for name, value in own.values.items()}
        rows.append(MeasuredRow(cells=cells, values=values))
    return rows


def given(text: str) -> tuple[str, Path]:
    """NAME=FILE; `ConfigurationError` for anything else."""
    name, equals, path = text.partition("=")
    if not (name and equals and path):
        raise ConfigurationError(f"'{text}': give each set as NAME=FILE, as away=figures.json")
    return name, Path(path)


def main(argv: Sequence[str] | None = None) -> int:
    """Print what `diagnose` reached in several sets, each with its intervals."""
    parser = argparse.ArgumentParser(prog="home_and_away", description=main.__doc__)
    parser.add_argument("sets", nargs="+", metavar="NAME=FILE", help="figures of a set of cases")
    parser.add_argument("--out", type=Path, help="file for the table (JSON)")
    arguments = parser.parse_args(argv)

    def body() -> None:
        sets = {name: MeasuredFigures.read(path) for name, path in map(given, arguments.sets)}
        command = " ".join(("python -m crane_benchmark.scores.home_and_away", *arguments.sets))
        columns = [COLUMNS[0]]
        for name, one in sets.items():
            columns += [f"aim {name}", one.columns[0]]
        tell(side_by_side(sets), columns, command, arguments.out, ())

    return cli.run(body)


if __name__ == "__main__":
    sys.exit(main())
