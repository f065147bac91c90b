"""How small a fault may be to be found, kind by kind."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from crane_benchmark.observing.failing import OTHERS
from crane_benchmark.observing.watched import MonitorAnswer

UNITS = {
    "jump": "rad, m",
    "drift": "rad/s, m/s",
    "noise": "rad, m",
    "backlash": "rad, m",
    "slow": "s",
    "leaking": "m³/(s Pa)",
}
OF_PRESSURE = {"offset": "Pa", "drift": "Pa/s", "noise": "Pa"}
COLUMNS = 4
NEIGHBOURS = 5  # cases over which a share is taken


def draw_curves(path: Path, answers: Sequence[MonitorAnswer]) -> None:
    """The share of faults that were found, by size: a point each case, the mean of neighbours."""
    from matplotlib.figure import Figure  # a second to import
    from matplotlib.ticker import NullFormatter

    asked = [one for one in OTHERS if one.sizes[0] < one.sizes[1]]
    rows = -(-len(asked) // COLUMNS)
    figure = Figure(figsize=(11.0, 2.3 * rows), layout="constrained")
    axes = figure.subplots(rows, COLUMNS, sharey=True).ravel()
    for axis, question in zip(axes, asked, strict=False):
        own = [one for one in answers if one.case.question == question]
        own.sort(key=lambda one: abs(one.case.fault.size))
        size = np.abs([one.case.fault.size for one in own])
        found = np.array([one.delay <= question.within for one in own], dtype=float)
        width = min(NEIGHBOURS, len(own))
        part = np.ones(width) / width
        middle = np.exp(np.convolve(np.log(size), part, "valid"))
        axis.plot(middle, 100.0 * np.convolve(found, part, "valid"), color="tab:blue")
        axis.plot(size, 100.0 * found, "o", color="tab:blue", markersize=3, alpha=0.6)
        axis.set_xscale("log")
        axis.set_xlim(*question.sizes)
        axis.xaxis.set_minor_formatter(NullFormatter())
        pressed = question.parts[0].startswith("pressure")
        unit = (OF_PRESSURE if pressed else UNITS).get(question.kind, "share")
        axis.set_title(question.what.replace("_", " "), fontsize=9)
        axis.set_xlabel(f"[{unit}]", fontsize=8)
        axis.tick_params(labelsize=7)
        axis.set_ylim(-8.0, 108.0)
    for axis in axes[len(asked) :]:
        axis.set_visible(False)
    for axis in axes[::COLUMNS]:
        axis.set_ylabel(f"found within {OTHERS[0].within:g} s [%]", fontsize=8)
    figure.savefig(path, dpi=110)
