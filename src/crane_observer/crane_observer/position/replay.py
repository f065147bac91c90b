"""The position sensor over a recording: the same numbers as those of the node."""

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from crane_model.array import Array, Flags
from crane_model.model_file import Model
from crane_observer.position.sensor import PositionSensor, SensorCondition, Told
from crane_observer.position.smoothing import Past
from crane_observer.recording import COMMAND, ENCODERS, HeardRecording


class EstimatedCourse(NamedTuple):
    """What the sensor told at n times, of j joints."""

    time: Array  # (n,) s
    position: Array  # (n, j)
    velocity: Array  # (n, j)
    deviation: Array  # (n, j)
    load: Array  # (n,) kg
    load_deviation: Array  # (n,) kg
    covariance: Array  # (n, j + 1, j + 1)
    observable: Flags  # (n, j)
    changed: Flags  # (n,) a load came or went
    conditions: tuple[SensorCondition, ...]


def replay(sensor: PositionSensor, recording: HeardRecording, hidden: Flags) -> EstimatedCourse:
    """Feed it the recording, without the encoders that are `hidden` (j,)."""
    return _course(list(_told(sensor, recording, hidden)))


def replay_smoothed(
    sensor: PositionSensor,
    recording: HeardRecording,
    hidden: Flags,
    watch: Callable[[float], None] = lambda _: None,
) -> tuple[EstimatedCourse, EstimatedCourse]:
    """The same, and beside it what it would have told, had it known all that came later; `watch`
    is told the time [s] of each window when it is done.
    """
    past, told = Past(sensor.hypotheses), []
    for one in _told(sensor, recording, hidden):
        told.append(one)
        past.add(sensor.window, sensor.hypotheses)
        watch(one.estimate.time)
    later = past.smoothed(sensor.hypotheses)
    smoothed = [one._replace(estimate=two) for one, two in zip(told, later, strict=True)]
    return _course(told), _course(smoothed)


def _told(sensor: PositionSensor, recording: HeardRecording, hidden: Flags) -> Iterator[Told]:
    for kind, k in recording.events():
        if kind == ENCODERS:
            shown = np.where(hidden, np.nan, recording.encoders[k])
            sensor.add_encoders(recording.encoder_time[k], shown)
        elif kind == COMMAND:
            sensor.add_command(recording.command_time[k], recording.commands[k])
        else:
            one = sensor.add_pressures(
                recording.pressure_time[k],
                recording.chamber_a[k],
                recording.chamber_b[k],
                recording.supply[k],
            )
            if one is not None:
                yield one


def _course(told: Sequence[Told]) -> EstimatedCourse:
    estimates = [one.estimate for one in told]
    deviation = np.array([one.deviation for one in estimates])
    return EstimatedCourse(
        np.array([one.time for one in estimates]),
        np.array([one.position for one in estimates]),
        np.array([one.velocity for one in estimates]),
        deviation[:, :-1],
        np.array([one.load for one in estimates]),
        deviation[:, -1],
        np.array([one.covariance for one in estimates]),
        np.array([one.observable for one in told]),
        np.array([one.surprised for one in estimates]),
        tuple(one.condition for one in told),
    )


# Errors of the position sensor over a recording, as it told them and smoothed, and the load.

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
