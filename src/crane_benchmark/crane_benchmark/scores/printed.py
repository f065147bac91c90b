"""What the benchmark prints."""

from typing import NamedTuple

from rich.table import Table

from crane_benchmark.cases.case import Site
from crane_benchmark.scores.judgement import OURS, laws
from crane_benchmark.scores.summary import BenchmarkSummary, Interval, Median, Rate
from crane_identification.report.terminal import plain_table

PERCENT = "{:.0%}"
OF_ALL = "{:.1%}"  # of all answers: one in 200 is not none


class TableLine(NamedTuple):
    """A line of the tables: its words, and what is aimed at on machines of each site."""

    words: str
    home: str = ""
    away: str = ""
    shown: str = PERCENT

    def aim(self, site: Site) -> str:
        """What is aimed at there."""
        return self.away if site is Site.AWAY else self.home


MEDIANS = {
    "gap_closed": TableLine("share of the explainable gap closed", "≥ 90 %", "≥ 85 %"),
    "gap_closed_by_learner": TableLine("the same by the flexible learner, all cases"),
    "parameter_error": TableLine("relative error of comparable parameters", shown="{:.1%}"),
    "seconds": TableLine("CPU time of a diagnosis", "≤ 10 s", "≤ 10 s", "{:.0f} s"),
}
"""Keys of medians in a summary."""
TARGETS = {
    "false_alarms": TableLine("nothing hidden: false alarms", "≤ 5 %", "≤ 5 %"),
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
    "twins": TableLine("twins: class"),
    "too_little_data": TableLine("too little data: said so"),
    "wrong_names": TableLine("all answers: wrong names", "≤ 1 %", "≤ 2 %", OF_ALL),
    "too_wide": TableLine("all answers: class too wide", shown=OF_ALL),
    "crashes": TableLine("all answers: crashed", "0 %", "0 %", OF_ALL),
}
"""Keys of the summary of a method."""


def tables(summary: BenchmarkSummary, site: Site = Site.HOME) -> list[Table]:
    """Rates of all methods, the power curve, and what only a diagnosis gives."""
    methods = summary.methods
    first = plain_table(f"{site.value}, {summary.cases} cases: share [95 % interval] of answers")
    power = plain_table("Right name and joint of single, identifiable effects, by strength")
    first.add_column("", no_wrap=True)
    first.add_column("aim", justify="right")
    power.add_column("strength")
    for name in methods:
        first.add_column(name, justify="right")
        power.add_column(name, justify="right")
    for key, line in TARGETS.items():
        first.add_row(
            line.words,
            line.aim(site),
            *(_rate(getattr(method, key), line.shown) for method in methods.values()),
        )
    power.add_column("flexible learner:\nsure of some law", justify="right")
    for strength in methods[OURS].power:
        curves = [*(method.power for method in methods.values()), summary.learner.power]
        power.add_row(f"{strength:.1%}", *(_rate(curve[strength], PERCENT) for curve in curves))
    last = plain_table("Named effects: median [95 % interval]")
    for heading in ("", "aim", "median", "cases"):
        last.add_column(heading)
    for key, line in MEDIANS.items():
        value: Median = getattr(summary, key)
        middle = _interval(value.median, value.interval, line.shown)
        last.add_row(line.words, line.aim(site), middle, str(value.of))
    return [first, power, last, *_stories(summary.stories)]


def _stories(stories: dict[str, dict[str, int]]) -> list[Table]:
    """What became of each, where cases tell stories."""
    if not stories:
        return []
    table = plain_table("What strangers found: outcomes of diagnose")
    for heading in ("story", "cases", "outcomes"):
        table.add_column(heading)
    for story, outcomes in stories.items():
        said = ", ".join(f"{count} {outcome}" for outcome, count in outcomes.items())
        table.add_row(story, str(sum(outcomes.values())), said)
    return [table]


def notes() -> list[str]:
    """What counts as right beyond the tables' words."""
    several = "; ".join(" = ".join(laws_) for laws_ in laws().values())
    return [
        f"Laws of one effect, any of which is right: {several}.",
        "A class is right if each of its members explains the hidden force as well as its own law;",
        "where the data are too few, it is right if it holds the hidden effect.",
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
