"""Tracking errors of the model-based controller and of the PD controller (36) on one motion."""

from typing import NamedTuple

import numpy as np
from laws import OUT
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from outcome import Following
from rich.table import Table

from crane_bags import read_topics
from crane_bags.types import JOINT_REFERENCE, JOINT_STATES
from crane_benchmark.rehearsal.crane_run import CraneRun
from crane_identification.report.terminal import plain_table
from crane_model import load_machine
from crane_model.result_file import NumberByJoint
from crane_trajectory.run_excitation_node import ExcitationResult

PICTURE = OUT / "following.png"
MOVED = 1e-3  # rad or m: a joint whose reference stays within was held
BEFORE, AFTER = "#c0392b", "#1f4e79"


class Followed(NamedTuple):
    """n instants of a recording."""

    time: np.ndarray  # (n,) s since the reference began
    reference: np.ndarray  # (n, j) rad, m
    error: np.ndarray  # (n, j) reference minus measured


def measured(law: CraneRun) -> Following:
    """How well, once both runs have been recorded."""
    before, after = _errors(law, "train"), _errors(law, "follow")
    held = np.ptp(_followed(law, "train").reference, axis=0) < MOVED
    ratios = {}
    for (joint, was), still in zip(before.items(), held, strict=True):
        now = after[joint]
        ratios[joint] = None if still or not was or not now else was / now
    return Following(controller=law.controller, tracking_rms=after, times_better=ratios)


def table(law: CraneRun, after: Following) -> Table:
    """RMS tracking errors with the PD controller (36), and with the model-based controller."""
    result = plain_table("RMS tracking error on the motion of the fit, live: before and after")
    result.add_column("joint", no_wrap=True)
    for heading in ("PD controller", after.controller, "times better"):
        result.add_column(heading, justify="right")
    before = _errors(law, "train")
    for joint, unit in load_machine(law.machine).units.items():
        better = after.times_better[joint]
        result.add_row(
            joint,
            *(f"{1e3 * (run[joint] or 0.0):.2f} m{unit}" for run in (before, after.tracking_rms)),
            "held" if better is None else f"{better:.0f}",
        )
    return result


def draw(law: CraneRun) -> None:
    """Draw the tracking errors of both runs over time, for each joint that moves."""
    machine = load_machine(law.machine)
    before, after = _followed(law, "train"), _followed(law, "follow")
    moved = np.flatnonzero(np.ptp(before.reference, axis=0) >= MOVED)
    figure = Figure(figsize=(11.0, 1.0 + 2.2 * len(moved)), layout="constrained")
    axes = figure.subplots(len(moved), 2, sharex=True, squeeze=False)
    axes[0, 0].set_title("tracking error")
    axes[0, 1].set_title("tracking error of the model-based controller, magnified")
    end = after.time[-1]
    name = f"model-based controller ({law.controller})"
    for row, i in zip(axes, moved, strict=True):
        joint = machine.joint_names[i]
        label = f"{joint.replace('_', ' ')} [m{machine.units[joint]}]"
        inside = before.time <= end
        _curve(row[0], before.time[inside], before.error[inside, i], BEFORE, "PD controller")
        _curve(row[0], after.time, after.error[:, i], AFTER, name)
        _curve(row[1], after.time, after.error[:, i], AFTER, name)
        row[0].set_ylabel(label)
    figure.legend(*axes[0, 0].get_legend_handles_labels(), loc="outside lower center", ncols=2)
    for panel in axes[-1]:
        panel.set_xlabel("time [s]")
        panel.set_xlim(0.0, end)
    figure.savefig(PICTURE, dpi=130)


def _curve(panel: Axes, time: np.ndarray, error: np.ndarray, colour: str, name: str) -> None:
    panel.plot(time, 1e3 * error, color=colour, lw=1.0, label=name)
    panel.axhline(0.0, color="0.8", lw=0.6, zorder=0)
    panel.spines[["top", "right"]].set_visible(False)


def _errors(law: CraneRun, use: str) -> NumberByJoint:
    return ExcitationResult.read(law.result(use)).rms_tracking_error


def _followed(law: CraneRun, use: str) -> Followed:
    """The reference of a bag, and the joint states with the same stamps."""
    topics = read_topics(law.bag(use), (JOINT_STATES, JOINT_REFERENCE))
    joints = load_machine(law.machine).joint_names
    states, references = (
        topics[topic.name].select(joints) for topic in (JOINT_STATES, JOINT_REFERENCE)
    )
    _, at, of = np.intersect1d(states.stamp, references.stamp, return_indices=True)
    wanted = references.fields["position"][of]
    time = 1e-9 * (references.stamp[of] - references.stamp[of][0])
    return Followed(time, wanted, wanted - states.fields["position"][at])
