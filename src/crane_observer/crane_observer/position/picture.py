"""Errors of the position sensor over a recording, as it told them and smoothed, and the load."""

from pathlib import Path

import numpy as np

from crane_model.array import Array, Flags
from crane_model.model_file import Model
from crane_observer.position.replay import EstimatedCourse

CONFIDENCE = 1.96  # standard deviations
ONLINE, LATER = "tab:blue", "tab:orange"


def draw(
    path: Path,
    model: Model,
    course: EstimatedCourse,
    smoothed: EstimatedCourse,
    reference: Array,
    hidden: Flags,
) -> None:
    """Write the picture; `reference` (n, j) is what encoders said, `hidden` (j,) whose are not
    used.
    """
    from matplotlib.figure import Figure  # a second to import

    joints = len(model.joints)
    figure = Figure(figsize=(9.0, 2.2 * (joints + 1)), layout="constrained")
    axes = figure.subplots(joints + 1, 1, sharex=True)
    for j, joint in enumerate(model.joints):
        unit = "mm" if model.setting.units[joint] == "m" else "mrad"
        for one, color, name in ((course, ONLINE, "estimate"), (smoothed, LATER, "smoothed")):
            around = CONFIDENCE * 1e3 * one.deviation[:, j]
            error = 1e3 * (one.position[:, j] - reference[:, j])
            axes[j].fill_between(one.time, -around, around, color=color, alpha=0.15, linewidth=0)
            axes[j].plot(one.time, error, linewidth=0.8, color=color, label=f"{name} − encoder")
        dark = np.where(course.observable[:, j], np.nan, 0.0)
        axes[j].plot(course.time, dark, color="tab:red", linewidth=3, label="not observable")
        axes[j].set_ylabel(f"{joint.replace('_', ' ')}\n[{unit}]")
        axes[j].set_title("without its encoder" if hidden[j] else "with its encoder", fontsize=9)
    axes[0].legend(loc="upper right", fontsize=8, title="with 95 % bands", title_fontsize=8)
    for one, color in ((course, ONLINE), (smoothed, LATER)):
        low, high = (one.load + sign * CONFIDENCE * one.load_deviation for sign in (-1.0, 1.0))
        axes[-1].fill_between(one.time, low, high, color=color, alpha=0.15, linewidth=0)
        axes[-1].plot(one.time, one.load, linewidth=0.8, color=color)
    axes[-1].set_ylabel("load [kg]")
    axes[-1].set_ylim(-30.0, max(50.0, 1.2 * float(course.load.max())))
    axes[-1].set_xlabel("time [s]")
    figure.savefig(path, dpi=110)
