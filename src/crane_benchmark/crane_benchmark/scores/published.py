"""The rates of the benchmark for the manual: those of `diagnose` with their 95 % intervals."""

import argparse
import re
import sys
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

from rich.table import Table

from crane_benchmark import measured
from crane_benchmark.cases.case import Simulator
from crane_benchmark.cases.case_sets import CaseSet
from crane_benchmark.measured import RESULT_COLUMNS, MeasuredFigures, MeasuredRow, tell
from crane_benchmark.scores.judgement import OURS, laws
from crane_benchmark.scores.summary import BenchmarkSummary, Interval, Median, MethodRates, Rate
from crane_identification.report.terminal import plain_table
from crane_model import cli
from crane_model.errors import ConfigurationError, DataError

PERCENT_FORMAT = "{:.0%}"
OF_ALL = "{:.1%}"  # of all answers: one in 200 is not none
SCORING_COMMAND = "make discrepancy-benchmark"  # of the scoring set
OF_A_SET = "ros2 run crane_benchmark discrepancy --set {} --cases {}"
NO_CASE = "–"
VALUE = re.compile(r"\{(\w+)")  # of a cell, where it is to stand


class TableLine(NamedTuple):
    """A line of the tables: its words, and what is aimed at on machines of each simulator."""

    words: str
    primary: str = ""
    independent: str = ""
    shown: str = PERCENT_FORMAT

    def aim(self, simulator: Simulator) -> str:
        return self.independent if simulator is Simulator.INDEPENDENT else self.primary


MEDIANS = {
    "gap_closed": TableLine("share of the explainable model error removed", "≥ 90 %", "≥ 85 %"),
    "gap_closed_by_learner": TableLine("the same by the flexible learner, all cases"),
    "parameter_error": TableLine("relative error of comparable parameters", shown="{:.1%}"),
    "seconds": TableLine("CPU time of a diagnosis", "≤ 10 s", "≤ 10 s", "{:.0f} s"),
}
"""Keys of medians in a summary."""
TARGETS = {
    "false_alarms": TableLine("nothing injected: false alarms", "≤ 5 %", "≤ 5 %"),
    "false_reassurance": TableLine(
        "all answers: none, though the error is above noise", "0", "0", OF_ALL
    ),
    "right_from_2_percent": TableLine("single, from 2 %, identifiable", "≥ 97 %", "≥ 92 %"),
    "right_from_2_percent_surveyed": TableLine("the same, lengths as in the file"),
    "right_from_2_percent_off": TableLine("the same, lengths not those of the file"),
    "right_from_2_percent_all": TableLine("single, from 2 %, all"),
    "hedged": TableLine("of the right ones: 'and something more'"),
    "right_at_1_percent": TableLine("single, 1 %, identifiable", "≥ 95 %", "≥ 80 %"),
    "pairs_at_4_percent": TableLine("pairs, 4 % each: both, only those", "≥ 90 %", "≥ 80 %"),
    "one_of_two": TableLine("pairs: one of them"),
    "unknown_recognised": TableLine("outside the catalogue: unknown", "≥ 95 %", "≥ 90 %"),
    "unknown_recognised_shown": TableLine("the same, identifiable"),
    "lengths_recognised": TableLine("lengths not those of the file: unknown, or a gain"),
    "ambiguous": TableLine("indistinguishable effects: ambiguous"),
    "too_little_data": TableLine("too little data: said so"),
    "wrong_names": TableLine("all answers: wrong names", "≤ 1 %", "≤ 2 %", OF_ALL),
    "too_wide": TableLine("all answers: ambiguity group too wide", shown=OF_ALL),
    "crashes": TableLine("all answers: crashed", "0 %", "0 %", OF_ALL),
}
"""Keys of the summary of a method."""


def tables(summary: BenchmarkSummary, simulator: Simulator = Simulator.PRIMARY) -> list[Table]:
    """Rates of all methods, the power curve, and what only a diagnosis gives."""
    methods = summary.methods
    first = plain_table(
        f"{simulator.value}, {summary.cases} cases: share [95 % interval] of answers"
    )
    power = plain_table(
        "Correct effect and joint of single, identifiable effects, by relative magnitude"
    )
    first.add_column("", no_wrap=True)
    first.add_column("aim", justify="right")
    power.add_column("relative magnitude")
    for name in methods:
        first.add_column(name, justify="right")
        power.add_column(name, justify="right")
    for key, line in TARGETS.items():
        first.add_row(
            line.words,
            line.aim(simulator),
            *(_rate(getattr(method, key), line.shown) for method in methods.values()),
        )
    power.add_column("flexible learner:\ncertain of some form", justify="right")
    for magnitude in methods[OURS].power:
        curves = [*(method.power for method in methods.values()), summary.learner.power]
        power.add_row(
            f"{magnitude:.1%}",
            *(_rate(curve[magnitude], PERCENT_FORMAT) for curve in curves),
        )
    last = plain_table("Named effects: median [95 % interval]")
    for heading in ("", "aim", "median", "cases"):
        last.add_column(heading)
    for key, line in MEDIANS.items():
        value: Median = getattr(summary, key)
        middle = _interval(value.median, value.interval, line.shown)
        last.add_row(line.words, line.aim(simulator), middle, str(value.of))
    return [first, power, last, *_stories(summary.stories)]


def _stories(stories: dict[str, dict[str, int]]) -> list[Table]:
    if not stories:
        return []
    table = plain_table("Outcomes of diagnose on blind cases")
    for heading in ("story", "cases", "outcomes"):
        table.add_column(heading)
    for story, outcomes in stories.items():
        said = ", ".join(f"{count} {outcome}" for outcome, count in outcomes.items())
        table.add_row(story, str(sum(outcomes.values())), said)
    return [table]


def notes() -> list[str]:
    """Return notes on further answers that count as correct."""
    several = "; ".join(" = ".join(laws_) for laws_ in laws().values())
    return [
        f"Forms of one effect, any of which is correct: {several}.",
        "An ambiguity group is correct if each member explains the injected force as well as its",
        "own form; if the data are too few, it is correct if it contains the injected effect.",
    ]


def _rate(value: Rate, shown: str) -> str:
    return f"{_interval(value.rate, value.interval, shown)} of {value.of}" if value.of else "-"


def _interval(value: float | None, interval: Interval | None, shown: str) -> str:
    if value is None:
        return "-"
    middle = shown.format(value)
    if interval is None:
        return middle
    low, high = (shown.format(end) for end in interval)
    return f"{middle} [{low}, {high}]"


def write(
    path: Path,
    summary: BenchmarkSummary,
    which: CaseSet = CaseSet.SCORING,
    simulator: Simulator = Simulator.PRIMARY,
) -> None:
    """Write the figures of a set at a simulator to `path`, by the summary of its results there."""
    scoring = which is CaseSet.SCORING
    command = SCORING_COMMAND if scoring else OF_A_SET.format(which.value, summary.cases)
    baselines = [name for name in summary.methods if name != OURS]
    columns = (f"{simulator.value}, {summary.cases} cases", "target", OURS, *baselines)
    measured.write(path, command, list(rows(summary, simulator)), columns)


def rows(summary: BenchmarkSummary, simulator: Simulator) -> Iterator[MeasuredRow]:
    """Each rate, with that of other methods beside it; then medians."""
    methods = {OURS: summary.methods[OURS], **summary.methods}
    for key, line in TARGETS.items():
        values: dict[str, float] = {}
        cells = [line.words, line.aim(simulator)]
        for place, method in enumerate(methods.values()):
            found: Rate = getattr(method, key)
            name = key if place == 0 else f"{key}_{place}"
            if found.rate is None or found.interval is None:
                cells.append(NO_CASE)
                continue
            values[name] = found.rate
            cells.append(_named(line.shown, name))
            if place == 0:
                values |= _ends(key, found.interval) | {f"{key}_of": found.of}
                cells[-1] += f" {_interval_format(line.shown, key)} of {{{key}_of:.0f}}"
        yield MeasuredRow(cells=cells, values=values)
    yield _power(methods)
    empty = [""] * (len(methods) - 1)
    for key, line in MEDIANS.items():
        shown = line.shown
        middle: Median = getattr(summary, key)
        if middle.median is None:
            continue
        values = {key: middle.median, f"{key}_of": middle.of}
        cell = _named(shown, key)
        if middle.interval is not None:
            values |= _ends(key, middle.interval)
            cell += f" {_interval_format(shown, key)}"
        yield MeasuredRow(
            cells=[line.words, line.aim(simulator), f"{cell} of {{{key}_of:.0f}}", *empty],
            values=values,
        )


def _power(methods: Mapping[str, MethodRates]) -> MeasuredRow:
    """Power for single identifiable effects, by relative magnitude."""
    magnitudes = list(methods[OURS].power)
    values: dict[str, float] = {}
    cells = []
    for place, method in enumerate(methods.values()):
        rates = {s: method.power[s].rate for s in magnitudes}
        named = {
            f"power_{place}_{s:g}".replace(".", "_"): rate
            for s, rate in rates.items()
            if rate is not None
        }
        values |= named
        cells.append(", ".join(f"{{{name}:.0%}}" for name in named) or NO_CASE)
    listed = ", ".join(f"{100.0 * s:g}" for s in magnitudes)
    return MeasuredRow(cells=[f"single, identifiable, of {listed} %", "", *cells], values=values)


def _ends(key: str, interval: Interval) -> dict[str, float]:
    return {f"{key}_low": interval[0], f"{key}_high": interval[1]}


def _interval_format(shown: str, key: str) -> str:
    return f"[{_named(shown, f'{key}_low')}, {_named(shown, f'{key}_high')}]"


def _named(shown: str, name: str) -> str:
    """A format of one value, with the name of it."""
    return shown.replace("{:", f"{{{name}:")


# Rates of sets of cases side by side, as of both simulators.
#
#     python -m crane_benchmark.scores.published \
#         primary=ROUND/primary/figures.json independent=ROUND/independent/figures.json
#
# A set is named as you like; its figures are those that the benchmark leaves beside its results, in
# the folder of a round.


def side_by_side(sets: Mapping[str, MeasuredFigures]) -> list[MeasuredRow]:
    """Results of `diagnose` in each of the sets, row by row of the first one.

    `DataError` if a set was not scored by the benchmark.
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
            reached = known[what]
            cells.append(reached.cells[1])
            cells.append(VALUE.sub(rf"{{of{place}_\1", reached.cells[figures.columns.index(OURS)]))
            values |= {f"of{place}_{name}": value for name, value in reached.values.items()}
        rows.append(MeasuredRow(cells=cells, values=values))
    return rows


def given(text: str) -> tuple[str, Path]:
    """NAME=FILE; `ConfigurationError` for anything else."""
    name, equals, path = text.partition("=")
    if not (name and equals and path):
        raise ConfigurationError(f"'{text}': give each set as NAME=FILE, as primary=figures.json")
    return name, Path(path)


def main(argv: Sequence[str] | None = None) -> int:
    """Print what `diagnose` reached in several sets, each with its intervals."""
    parser = argparse.ArgumentParser(prog="published", description=main.__doc__)
    parser.add_argument("sets", nargs="+", metavar="NAME=FILE", help="figures of a set of cases")
    parser.add_argument("--out", type=Path, help="file for the table (JSON)")
    arguments = parser.parse_args(argv)

    def body() -> None:
        sets = {name: MeasuredFigures.read(path) for name, path in map(given, arguments.sets)}
        command = " ".join(("python -m crane_benchmark.scores.published", *arguments.sets))
        columns = [RESULT_COLUMNS[0]]
        for name, figures in sets.items():
            columns += [f"aim {name}", figures.columns[0]]
        tell(side_by_side(sets), columns, command, arguments.out, ())

    return cli.run(body)


if __name__ == "__main__":
    sys.exit(main())
