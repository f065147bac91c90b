"""Pictures of the results: power over magnitude, and confusion."""

from collections.abc import Sequence
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

from crane_benchmark.cases.case import CaseKind
from crane_benchmark.cases.case_sets import RELATIVE_MAGNITUDES
from crane_benchmark.scores.judgement import OURS, Judgement
from crane_benchmark.scores.summary import (
    CaseRow,
    learnt,
    of_kind,
    power,
    share,
)

COLOURS = ("#1f5fa8", "#c4552d", "#3a8f5c", "#7a7a7a", "#8a5fa8")
VERDICTS = ("unknown", "none", "insufficient_data", "crash")
DPI = 140
LEARNER = "flexible learner, no name"
NARROW = 0.06  # of a step, by which curves stand apart so that their intervals can be read


def write(folder: Path, rows: Sequence[CaseRow]) -> None:
    """power.png and confusion.png."""
    mpl.rcParams.update({"font.size": 9, "axes.spines.top": False, "axes.spines.right": False})
    for name, figure in (
        ("power", _power(rows)),
        ("confusion", _confusion(rows)),
    ):
        figure.savefig(folder / f"{name}.png", dpi=DPI, bbox_inches="tight")


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
