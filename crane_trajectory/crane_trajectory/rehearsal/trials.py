"""Trials of a controller on the twin of a crane: with other gains, later commands, side by side."""

from collections.abc import Callable, Iterable, Sequence
from typing import NamedTuple

import numpy as np

from crane_model.model_file import Model
from crane_model.twin import CYCLE, Twin
from crane_model.whole_crane import identified
from crane_trajectory.control.interface import (
    ControlCondition,
    Controller,
    Point,
    SensorReading,
    Wanted,
)
from crane_trajectory.motion.motion import Motion

SWINGS = 3.0  # Hz, above which speed beside the reference is ripple

Steps = Callable[[Iterable[int]], Iterable[int]]


class GainTrial(NamedTuple):
    """A run beside others."""

    scale: float  # of the gains
    late: float  # s, more than the loop is


class Tried(NamedTuple):
    """What came of N trials over the periods of a motion; j joints of the model."""

    rms: np.ndarray  # (N, j) of the tracking error, rad, m
    ripple: np.ndarray  # (N, j) rms of speed beside the reference above `SWINGS` over its own rms
    worst: tuple[ControlCondition, ...]  # (N,)


def run_trials(
    model: Model,
    motion: Motion,
    trials: Sequence[GainTrial],
    controller: Callable[[float], Controller],
    progress: Steps = iter,
) -> Tried:
    """Lead the twin through the motion once for each trial; `controller` makes one of a scale.

    Joints that the model lacks stand on their reference. Sensors show the truth.
    """
    machine, known = identified(model)
    columns = [machine.index(joint) for joint in model.joints]
    delay = float(np.mean([known.joints[joint].valve.delay for joint in model.joints]))
    start = np.tile(motion.start[columns], (len(trials), 1))
    twin = Twin(model, start, delay + np.array([trial.late for trial in trials]))
    made = [controller(trial.scale) for trial in trials]
    for one in made:
        one.start(np.zeros(len(motion.start)))
    times = np.arange(0.0, motion.excitation_end, CYCLE)
    now, ahead = (motion.reference(times + later) for later in (0.0, made[0].preview))
    shape = (len(times), *start.shape)
    error, beside = np.empty(shape), np.empty(shape)
    worst = [ControlCondition.AT_REST] * len(trials)
    for k in progress(range(len(times))):
        here, there = (Point(*(part[k] for part in one[:3])) for one in (now, ahead))
        wanted = Wanted(here, there)
        q, v = twin.position, twin.velocity
        error[k] = now.position[k, columns] - q
        beside[k] = v - now.velocity[k, columns]
        p_a, p_b, supply = twin.pressures
        u = np.empty(start.shape)
        for n, one in enumerate(made):
            reading = SensorReading(
                _beside(now.position[k], columns, q[n]),
                _beside(np.zeros(len(motion.start)), columns, v[n]),
                _beside(np.full(len(motion.start), np.nan), columns, p_a[n]),
                _beside(np.full(len(motion.start), np.nan), columns, p_b[n]),
                float(supply[n]),
            )
            u[n] = one.command(CYCLE, reading, wanted)[columns]
            worst[n] = max(worst[n], *one.conditions)
        twin.advance(u, CYCLE)
    inside = times >= motion.excitation_start
    speed = np.sqrt(np.mean(now.velocity[inside][:, columns] ** 2, axis=0))
    spectrum = np.fft.rfft(beside[inside], axis=0)
    spectrum[np.fft.rfftfreq(int(inside.sum()), CYCLE) < SWINGS] = 0.0
    swings = np.fft.irfft(spectrum, int(inside.sum()), axis=0)
    return Tried(
        np.sqrt(np.mean(error[inside] ** 2, axis=0)),
        np.sqrt(np.mean(swings**2, axis=0)) / np.maximum(speed, 1e-9),
        tuple(worst),
    )


def _beside(others: np.ndarray, columns: list[int], values: np.ndarray) -> np.ndarray:
    found = others.copy()
    found[columns] = values
    return found
