"""What the benchmark prints."""

from rich.table import Table

from crane_benchmark.scores.judgement import OURS, laws
from crane_benchmark.scores.rates import Interval, Median, Rate
from crane_benchmark.scores.summary import BenchmarkSummary
from crane_identification.report.terminal import plain_table

MEDIANS = {
    "gap_closed": ("share of the explainable gap closed", "≥ 80 %", "{:.0%}"),
    "gap_closed_by_learner": ("the same by the flexible learner, all cases", "", "{:.0%}"),
    "parameter_error": ("relative error of comparable parameters", "", "{:.1%}"),
    "seconds": ("CPU time of a diagnosis", "", "{:.0f} s"),
}
"""Keys of medians in a summary, what they are, what is aimed at, and how they are printed."""
TARGETS = {
    "false_alarms": ("nothing hidden: false alarms", "≤ 5 %"),
    "right_from_2_percent": ("single, from 2 %, identifiable", "≥ 95 %"),
    "right_from_2_percent_all": ("single, from 2 %, all", ""),
    "hedged": ("of the right ones: 'and something more'", ""),
    "right_at_1_percent": ("single, 1 %, identifiable", "≥ 80 %"),
    "pairs_at_4_percent": ("pairs, 4 % each: both, only those", "≥ 85 %"),
    "one_of_two": ("pairs: one of them", ""),
    "unknown_recognised": ("outside the catalogue: unknown", "≥ 90 %"),
    "twins": ("twins: class", ""),
    "too_little_data": ("too little data: said so", ""),
    "wrong_names": ("all answers: wrong names", "≤ 2 %"),
    "too_wide": ("all answers: class too wide", ""),
    "crashes": ("all answers: crashed", "0 %"),
}
"""Keys of the summary of a method, what they are, and what is aimed at."""


def tables(summary: BenchmarkSummary) -> list[Table]:
    """Rates of all methods, the power curve, and what only a diagnosis gives."""
    methods = summary.methods
    first = plain_table(f"{summary.cases} cases: share [95 % interval] of answers")
    power = plain_table("Right name and joint of single, identifiable effects, by strength")
    first.add_column("", no_wrap=True)
    first.add_column("aim", justify="right")
    power.add_column("strength")
    for name in methods:
        first.add_column(name, justify="right")
        power.add_column(name, justify="right")
    for key, (words, target) in TARGETS.items():
        first.add_row(words, target, *(_rate(getattr(method, key)) for method in methods.values()))
    power.add_column("flexible learner:\nsure of some law", justify="right")
    for strength in methods[OURS].power:
        curves = [*(method.power for method in methods.values()), summary.learner.power]
        power.add_row(f"{strength:.1%}", *(_rate(curve[strength]) for curve in curves))
    last = plain_table("Named effects: median [95 % interval]")
    for heading in ("", "aim", "median", "cases"):
        last.add_column(heading)
    for key, (words, target, shown) in MEDIANS.items():
        value: Median = getattr(summary, key)
        last.add_row(words, target, _interval(value.median, value.interval, shown), str(value.of))
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


def _rate(value: Rate) -> str:
    return f"{_interval(value.rate, value.interval, '{:.0%}')} of {value.of}" if value.of else "-"


def _interval(value: float | None, interval: Interval | None, shown: str) -> str:
    if value is None:
        return "-"
    middle = shown.format(value)
    if interval is None:
        return middle
    low, high = (shown.format(end) for end in interval)
    return f"{middle} [{low}, {high}]"
