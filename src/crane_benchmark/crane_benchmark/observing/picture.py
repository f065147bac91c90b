"""How small a fault may be to be found, and how long that takes, kind by kind."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from scipy.optimize import isotonic_regression

from crane_benchmark.observing.failing import OTHERS, MonitorAnswer

if TYPE_CHECKING:
    from matplotlib.axes import Axes

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
WITHIN = OTHERS[0].within  # s
SOONEST = 0.02  # s that are drawn
MISSED = 1.8 * WITHIN  # s, where what was not found in time is drawn


def shares(answers: Sequence[MonitorAnswer]) -> tuple[np.ndarray, np.ndarray]:
    """Sizes (n,) in their order, and the share (n,) that is found in time of faults so large: what
    fits the cases best of all that never falls as faults grow.
    """
    if not answers:
        return np.zeros(0), np.zeros(0)
    ordered = sorted(answers, key=lambda one: abs(one.case.fault.size))
    size = np.abs([one.case.fault.size for one in ordered])
    found = np.array([one.delay <= one.case.question.within for one in ordered], dtype=float)
    return size, np.asarray(isotonic_regression(found).x)


def _mark(axis: "Axes", answers: Sequence[MonitorAnswer]) -> None:
    """Cases by what came of them."""
    for label, marker, color, right, in_time in (
        ("found", "o", "tab:blue", True, True),
        ("another sensor named", "x", "tab:red", False, True),
        ("not found in time", "^", "gray", None, False),
    ):
        own = [
            one
            for one in answers
            if (one.delay <= WITHIN) == in_time and right in (None, one.right)
        ]
        size = [abs(one.case.fault.size) for one in own]
        delay = [max(one.delay, SOONEST) if in_time else MISSED for one in own]
        axis.plot(size, delay, marker, color=color, markersize=4, alpha=0.7, label=label)


def draw_curves(path: Path, answers: Sequence[MonitorAnswer]) -> None:
    """Of each kind a panel: a mark for each case, at its size and the time until it was found, and
    the share that is found in time.
    """
    from matplotlib.figure import Figure  # a second to import
    from matplotlib.ticker import NullFormatter

    asked = [one for one in OTHERS if one.sizes[0] < one.sizes[1]]
    rows = -(-len(asked) // COLUMNS)
    figure = Figure(figsize=(11.0, 2.3 * rows), layout="constrained")
    axes = figure.subplots(rows, COLUMNS, sharey=True).ravel()
    for k, (axis, question) in enumerate(zip(axes, asked, strict=False)):
        own = [one for one in answers if one.case.question == question]
        _mark(axis, own)
        share = axis.twinx()
        size, found = shares(own)
        share.step(size, 100.0 * found, where="mid", color="tab:blue", alpha=0.5)
        share.set_ylim(0.0, 108.0)
        share.set_yticks([0, 50, 100])
        share.tick_params(labelsize=7, labelcolor="tab:blue", labelright=k % COLUMNS == COLUMNS - 1)
        axis.set_xscale("log")
        axis.set_xlim(*question.sizes)
        axis.xaxis.set_minor_formatter(NullFormatter())
        pressed = question.parts[0].startswith("pressure")
        unit = (OF_PRESSURE if pressed else UNITS).get(question.kind, "share")
        axis.set_title(question.what.replace("_", " "), fontsize=9)
        axis.set_xlabel(f"[{unit}]", fontsize=8)
        axis.tick_params(labelsize=7)
        axis.set_yscale("log")
        axis.set_ylim(SOONEST, 1.5 * MISSED)
    for axis in axes[len(asked) :]:
        axis.set_visible(False)
    for axis in axes[::COLUMNS]:
        axis.set_ylabel("found after [s]", fontsize=8)
    handles, labels = axes[0].get_legend_handles_labels()
    (curve,) = figure.axes[len(axes)].lines  # the share of the first panel
    handles, labels = [*handles, curve], [*labels, f"share found within {WITHIN:g} s [%]"]
    figure.legend(handles, labels, loc="lower right", fontsize=9)
    figure.savefig(path, dpi=110)
