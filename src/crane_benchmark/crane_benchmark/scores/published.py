"""The rates of the benchmark for the manual: those of `diagnose` with their 95 % intervals."""

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import NamedTuple

from crane_benchmark.cases.case import Simulator
from crane_benchmark.cases.case_sets import CaseSet
from crane_benchmark.measured import MeasuredRow, tell
from crane_benchmark.scores.judgement import OURS, laws
from crane_benchmark.scores.summary import BenchmarkSummary, Interval, Median, MethodRates, Rate

PERCENT_FORMAT = "{:.0%}"
OF_ALL = "{:.1%}"  # of all answers: one in 200 is not none
SCORING_COMMAND = "make discrepancy-benchmark"  # of the scoring set
OF_A_SET = "ros2 run crane_benchmark discrepancy --set {} --cases {}"
NO_CASE = "–"


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


def tell_rates(path: Path, which: CaseSet, simulator: Simulator, summary: BenchmarkSummary) -> None:
    """Print the rates of a set at a simulator, and write them to `path`."""
    scoring = which is CaseSet.SCORING
    command = SCORING_COMMAND if scoring else OF_A_SET.format(which.value, summary.cases)
    baselines = [name for name in summary.methods if name != OURS]
    columns = (f"{simulator.value}, {summary.cases} cases", "target", OURS, *baselines)
    tell(list(rows(summary, simulator)), columns, command, path, ())


def notes() -> list[str]:
    """Return notes on further answers that count as correct."""
    several = "; ".join(" = ".join(laws_) for laws_ in laws().values())
    return [
        f"Forms of one effect, any of which is correct: {several}.",
        "An ambiguity group is correct if each member explains the injected force as well as its",
        "own form; if the data are too few, it is correct if it contains the injected effect.",
    ]


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
