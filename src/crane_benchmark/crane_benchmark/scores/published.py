"""The rates of the benchmark for the manual: those of `diagnose` with their 95 % intervals."""

from collections.abc import Iterator, Mapping
from pathlib import Path

from crane_benchmark import measured
from crane_benchmark.cases.case import Site
from crane_benchmark.cases.case_sets import CaseSet
from crane_benchmark.measured import MeasuredRow
from crane_benchmark.scores.judgement import OURS
from crane_benchmark.scores.printed import MEDIANS, TARGETS
from crane_benchmark.scores.summary import BenchmarkSummary, Interval, Median, MethodRates, Rate

COMMAND = "make discrepancy-benchmark"  # of the scoring set
OF_A_SET = "ros2 run crane_benchmark discrepancy --set {} --cases {}"
NO_CASE = "–"


def write(
    path: Path,
    summary: BenchmarkSummary,
    which: CaseSet = CaseSet.SCORING,
    site: Site = Site.HOME,
) -> None:
    """Write the figures of a set at a site to `path`, by the summary of its results there."""
    scoring = which is CaseSet.SCORING
    command = COMMAND if scoring else OF_A_SET.format(which.value, summary.cases)
    others = [name for name in summary.methods if name != OURS]
    columns = (f"{site.value}, {summary.cases} cases", "target", OURS, *others)
    measured.write(path, command, list(rows(summary, site)), columns)


def rows(summary: BenchmarkSummary, site: Site) -> Iterator[MeasuredRow]:
    """Each rate, with that of other methods beside it; then medians."""
    methods = {OURS: summary.methods[OURS], **summary.methods}
    for key, line in TARGETS.items():
        values: dict[str, float] = {}
        cells = [line.words, line.aim(site)]
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
                cells[-1] += f" {_interval(line.shown, key)} of {{{key}_of:.0f}}"
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
            cell += f" {_interval(shown, key)}"
        yield MeasuredRow(
            cells=[line.words, line.aim(site), f"{cell} of {{{key}_of:.0f}}", *empty], values=values
        )


def _power(methods: Mapping[str, MethodRates]) -> MeasuredRow:
    """Of single effects that can be identified, by strength."""
    strengths = list(methods[OURS].power)
    values: dict[str, float] = {}
    cells = []
    for place, method in enumerate(methods.values()):
        rates = {s: method.power[s].rate for s in strengths}
        named = {
            f"power_{place}_{s:g}".replace(".", "_"): rate
            for s, rate in rates.items()
            if rate is not None
        }
        values |= named
        cells.append(", ".join(f"{{{name}:.0%}}" for name in named) or NO_CASE)
    listed = ", ".join(f"{100.0 * s:g}" for s in strengths)
    return MeasuredRow(cells=[f"single, identifiable, of {listed} %", "", *cells], values=values)


def _ends(key: str, interval: Interval) -> dict[str, float]:
    return {f"{key}_low": interval[0], f"{key}_high": interval[1]}


def _interval(shown: str, key: str) -> str:
    """A format of the ends of an interval."""
    return f"[{_named(shown, f'{key}_low')}, {_named(shown, f'{key}_high')}]"


def _named(shown: str, name: str) -> str:
    """A format of one value, with the name of it."""
    return shown.replace("{:", f"{{{name}:")
