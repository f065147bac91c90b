"""The position sensor over a recording: the same numbers as those of the node."""

from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple

import numpy as np

from crane_model.array import Array, Flags
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
