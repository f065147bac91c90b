"""Pictures of the results: power over magnitude, calibration of the threshold, confusion."""

from collections.abc import Sequence
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter, PercentFormatter

from crane_benchmark.answers.answer_cases import AnswerStatistics
from crane_benchmark.cases.case import CaseKind
from crane_benchmark.cases.case_sets import RELATIVE_MAGNITUDES
from crane_benchmark.scores.judgement import OURS, Judgement
from crane_benchmark.scores.summary import (
    CaseRow,
    Rate,
    identifiable,
    learnt,
    of_kind,
    power,
    rate,
    share,
)
from crane_model.result_file import ResultPart

TAIL = 4  # the largest values, one in so many, say how a tail falls off
LEVEL = 97  # %, of the bootstrap quantile that null cases are compared with
COLOURS = ("#1f5fa8", "#c4552d", "#3a8f5c", "#7a7a7a", "#8a5fa8")
VERDICTS = ("unknown", "none", "insufficient_data", "crash")
DPI = 140
LEARNER = "flexible learner, no name"
NARROW = 0.06  # of a step, by which curves stand apart so that their intervals can be read


def together(
    values: np.ndarray, allowed: float, least: Sequence[float] = ()
) -> tuple[np.ndarray, int]:
    """Limits (g,) of gates with these `values` (n, g) in n null cases, of which the share `allowed`
    may pass any; and how many pass.

    Each gate gets the same part of the alarms, by the fall of its tail, and none becomes lower than
    its `least`. If too many pass, all are raised together, one value at a time, with a margin of
    half a step.
    """
    ordered = np.sort(values, axis=0)
    count, gates = values.shape
    floors = np.maximum(tails(ordered, allowed / gates), least if len(least) else 0.0)
    for rank in range(count):
        above = ordered[min(rank + 1, count - 1)]
        limits = np.maximum((ordered[rank] + above) / 2.0, floors)
        alarms = int((values > limits).any(axis=1).sum())
        if alarms <= allowed * count:
            break
    return limits, alarms


def tails(ordered: np.ndarray, share: float) -> np.ndarray:
    """(g,) what this `share` of cases is above, by exponential tails of sorted values (n, g).

    60 cases hold no 0.6 % quantile; the median step of the largest quarter, which one odd case does
    not move, tells where it lies. Zero for gates that most cases do not even reach.
    """
    count = max(len(ordered) // TAIL, 1)
    start = ordered[-count - 1]
    fall = np.median(ordered[-count:] - start, axis=0) / np.log(2.0)
    return np.where(fall > 0.0, start + fall * np.log(count / (share * len(ordered))), 0.0)


class BootstrapAgreement(ResultPart):
    """Scores of null cases over the bootstrap's promise, in units of the threshold."""

    level: float
    """Quantile of the bootstrap that cases are compared with [-]."""
    above: Rate
    """Share of cases above it; the share that it leaves, if both agree."""
    found: list[float]
    """Scores, sorted [-]."""
    promised: list[float]
    """Those at the same ranks by the bootstrap [-]."""


def agreement(known: Sequence[AnswerStatistics]) -> BootstrapAgreement:
    """How far both agree."""
    score = np.array([row.best for row in known])
    promised = np.array([row.promised for row in known])  # (n, 101)
    levels = 100.0 * (np.arange(len(score)) + 0.5) / len(score)
    return BootstrapAgreement(
        level=LEVEL / 100.0,
        above=rate((score > promised[:, LEVEL]).tolist()),
        found=np.sort(score).tolist(),
        promised=np.interp(levels, np.arange(101), promised.mean(axis=0)).tolist(),
    )


def write(folder: Path, rows: Sequence[CaseRow]) -> None:
    """power.png, threshold.png and confusion.png."""
    mpl.rcParams.update({"font.size": 9, "axes.spines.top": False, "axes.spines.right": False})
    for name, figure in (
        ("power", _power(rows)),
        ("threshold", _threshold(rows)),
        ("confusion", _confusion(rows)),
    ):
        if figure is not None:
            figure.savefig(folder / f"{name}.png", dpi=DPI, bbox_inches="tight")


def write_agreement(folder: Path, agreement: BootstrapAgreement) -> None:
    """bootstrap.png: sorted scores of null cases over what the bootstrap promises."""
    figure = Figure(figsize=(5.0, 5.2), layout="constrained")
    axes = figure.add_subplot()
    found, promised = np.array(agreement.found), np.array(agreement.promised)
    ends = 0.8 * min(found.min(), promised.min()), 1.25 * max(found.max(), promised.max(), 1.0)
    axes.plot(ends, ends, color="0.6", linewidth=1, label="agreement")
    axes.axhline(1.0, color=COLOURS[1], linewidth=1, linestyle="--", label="threshold, factor 1")
    axes.plot(promised, found, "o", markersize=4, color=COLOURS[0], label="a case")
    axes.set(
        xlabel="best score promised by the bootstrap, over its 98.5 % quantile",
        ylabel="best score through the whole sensor chain, in the same unit",
        xscale="log",
        yscale="log",
        xlim=ends,
        ylim=ends,
        aspect="equal",
    )
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_locator(LogLocator(subs=(1, 2, 5)))
        axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        axis.set_minor_formatter(NullFormatter())
    axes.grid(alpha=0.3)
    figure.legend(frameon=False, loc="outside upper left", ncols=3)
    figure.savefig(folder / "bootstrap.png", dpi=DPI)


def _power(rows: Sequence[CaseRow]) -> Figure:
    """Correct effect and joint over the relative magnitude, ours and others, and the learner's."""
    figure = Figure(figsize=(7.2, 4.4), layout="constrained")
    axes = figure.add_subplot()
    methods = list(dict.fromkeys(name for row in rows for name in row.outcomes))
    nothing, sees = of_kind(rows, CaseKind.NOTHING), learnt(rows)
    curves = {
        name: (power(rows, name), share(nothing, name, Judgement.FALSE_ALARM)) for name in methods
    }
    curves[LEARNER] = sees.power, sees.false_alarms
    for number, (method, (curve, alarms)) in enumerate(curves.items()):
        known = [s for s in RELATIVE_MAGNITUDES if curve[s].of]
        shift = 2.0 ** (NARROW * (number - (len(curves) - 1) / 2))
        middle = np.array([curve[s].rate for s in known])
        ends = np.array([curve[s].interval for s in known]).reshape(-1, 2)
        told = "" if alarms.rate is None else f" ({alarms.rate:.0%} false alarms)"
        axes.errorbar(
            np.array(known) * 100 * shift,
            100 * middle,
            100 * np.abs(ends.T - middle),
            marker="o",
            markersize=4,
            capsize=2,
            linewidth=2 if method == OURS else 1.2,
            linestyle="--" if method == LEARNER else "-",
            color=COLOURS[number % len(COLOURS)],
            label=method + told,
        )
    counts = power(rows, OURS)
    axes.set_xscale("log")
    axes.set_xticks(
        [100 * s for s in RELATIVE_MAGNITUDES],
        [f"{100 * s:g} %\nn = {counts[s].of}" for s in RELATIVE_MAGNITUDES],
    )
    axes.minorticks_off()
    axes.set(
        xlabel="magnitude of the injected effect: its rms force relative to the drive force",
        ylabel="correct effect and joint [%], 95 % interval",
        ylim=(-3, 103),
    )
    axes.set_xlim(80 * RELATIVE_MAGNITUDES[0], 125 * RELATIVE_MAGNITUDES[-1])
    figure.legend(frameon=False, loc="outside upper left", ncols=2)
    return figure


def _threshold(rows: Sequence[CaseRow]) -> Figure | None:
    """How far the best score is above what noise gives, without and with an injected effect."""
    groups = (
        ("nothing injected", of_kind(rows, CaseKind.NOTHING)),
        ("single effects", [row for row in of_kind(rows, CaseKind.SINGLE) if identifiable(row)]),
        ("outside the catalogue", of_kind(rows, CaseKind.OUTSIDE)),
    )
    figure = Figure(figsize=(7.2, 3.4), layout="constrained")
    left, right = figure.subplots(1, 2, sharey=True)
    drawn = [
        _survival(axes, groups, key, words)
        for axes, key, words in (
            (left, "best", "best score over its quantile from noise"),
            (right, "learner", "relative magnitude of the model form that a learner finds"),
        )
    ]
    if not any(drawn):
        return None
    left.set_ylabel("share of cases above")
    left.set_xscale("log")
    left.yaxis.set_major_formatter(PercentFormatter(1.0, decimals=0))
    right.xaxis.set_major_formatter(PercentFormatter(1.0))
    figure.legend(
        *left.get_legend_handles_labels(), frameon=False, loc="outside upper left", ncols=3
    )
    return figure


def _survival(
    axes: Axes, groups: Sequence[tuple[str, Sequence[CaseRow]]], key: str, words: str
) -> bool:
    there = False
    for number, (name, rows) in enumerate(groups):
        values = sorted(getattr(row.statistics, key) for row in rows if row.statistics)
        if values:
            there = True
            above = 1.0 - np.arange(len(values) + 1) / len(values)
            axes.step([*values, values[-1]], above, where="pre", color=COLOURS[number], label=name)
    axes.set_xlabel(words)
    axes.grid(alpha=0.3)
    return there


def _confusion(rows: Sequence[CaseRow]) -> Figure:
    """Counts of injected effects (rows) against headlines of the answers (columns)."""

    def truth(row: CaseRow) -> str:
        if row.kind == CaseKind.SINGLE:
            return row.hidden[0].wanted.effect
        return f"({row.kind})"

    table: dict[tuple[str, str], int] = {}
    for row in rows:
        if row.kind != CaseKind.PAIR:
            place = truth(row), row.answers[OURS].headline
            table[place] = table.get(place, 0) + 1
    down = sorted({t for t, _ in table}, key=lambda name: (name.startswith("("), name))
    said = {a for _, a in table}
    across = [name for name in down if name in said]
    across += sorted(said - set(across) - set(VERDICTS)) + [v for v in VERDICTS if v in said]
    counts = np.zeros((len(down), len(across)))
    for (t, a), n in table.items():
        counts[down.index(t), across.index(a)] = n
    size = 0.27
    figure = Figure(
        figsize=(2.6 + size * len(across), 2.0 + size * len(down)), layout="constrained"
    )
    axes = figure.add_subplot()
    axes.imshow(counts / counts.sum(axis=1, keepdims=True), cmap="Blues", vmin=0, vmax=1)
    for (i, k), number in np.ndenumerate(counts):
        if number:
            colour = "w" if number > 0.5 * counts[i].sum() else "k"
            axes.text(k, i, f"{number:.0f}", ha="center", va="center", color=colour)
    axes.set_yticks(range(len(down)), [name.replace("_", " ") for name in down])
    axes.set_xticks(range(len(across)), [name.replace("_", " ") for name in across], rotation=90)
    axes.set(xlabel="named first, or verdict", ylabel="injected effect")
    axes.spines[:].set_visible(False)
    axes.set_xticks(np.arange(-0.5, len(across)), minor=True)
    axes.set_yticks(np.arange(-0.5, len(down)), minor=True)
    axes.grid(which="minor", color="0.92")
    axes.tick_params(which="both", length=0)
    return figure
