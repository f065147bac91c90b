"""Simulated against measured motion from the valve commands alone: the whole crane, open loop."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from crane_identification.data.log import Log
from crane_identification.options import Options
from crane_identification.preparation.prepare import prepare
from crane_model.cylinders import lever_arm
from crane_model.errors import CraneError, DataError
from crane_model.model_file import Model
from crane_model.record import Record
from crane_model.whole_crane import (
    CraneState,
    circuit_of,
    identified,
    simulate_openings,
    substeps,
    valve_openings,
)

HORIZONS = (1.0, 5.0)  # s ahead
BESIDE = ("run", "slew_position", "slew_velocity", "slew_acceleration", "temperature")
NEEDED = ("command", "pressure_a", "pressure_b")
HISTORY = 0.5  # s of commands before a window, after which the spool has forgotten what was before


class CommandedCourse(NamedTuple):
    """Measured and simulated position (n, j) [rad, m] at time (n,) [s] of all windows of a run, one
    behind the other; NaN where one ends and the next begins at the measured state.
    """

    source: str
    time: np.ndarray
    measured: np.ndarray
    simulated: np.ndarray


@dataclass(frozen=True)
class CommandValidation:
    """Rms position error after `horizon` [s] of simulation from a measured state, over all
    `windows`, and the mean way that the joint itself went in that time, (j,) each [rad, m].
    """

    joints: tuple[str, ...]
    horizon: float
    windows: int
    position_rms: np.ndarray
    way: np.ndarray
    courses: tuple[CommandedCourse, ...]  # one of each run

    @property
    def relative(self) -> np.ndarray:
        """Error over way, (j,); nan where a joint does not move."""
        with np.errstate(invalid="ignore", divide="ignore"):
            return np.asarray(self.position_rms / self.way)


def validate_commands(
    model: Model, logs: Sequence[Log], options: Options | None = None
) -> tuple[CommandValidation, ...]:
    """Simulate `model` over consecutive windows of `logs`, for each of HORIZONS that fits.

    `ConfigurationError` if the model has no values or no hydraulics, `DataError` if the recordings
    hold no commands or pressures, or no window.
    """
    circuit_of(model)  # says what is not identified, before any recording is prepared
    options = options or Options()
    whole = Options(begin=options.begin, end=options.end, average=False)
    return validate_runs(
        model,
        [
            CommandedRun(log, preparation.record, preparation.step)
            for log in logs
            for preparation in prepare(model, _complete(log), whole)
        ],
    )


def validate_runs(model: Model, runs: Sequence["CommandedRun"]) -> tuple[CommandValidation, ...]:
    """The same over runs that are prepared."""
    for run in runs:
        _complete(run.log)
    found = [one for one in (_ahead(model, runs, horizon) for horizon in HORIZONS) if one]
    if not found:
        raise DataError(
            f"simulation from commands: no window of {HORIZONS[0]:g} s in which commands are known "
            "fits into the recordings; record longer ones"
        )
    return tuple(found)


def commands_validated(
    model: Model, logs: Sequence[Log], options: Options
) -> tuple[CommandValidation, ...]:
    """The same, or none where it cannot be."""
    try:
        return validate_commands(model, logs, options)
    except CraneError:
        return ()


class CommandedRun(NamedTuple):
    """A gapless run of a recording, sampled every `step` [s], and the log with its commands."""

    log: Log
    record: Record
    step: float


def _complete(log: Log) -> Log:
    """The log; `DataError` where it lacks what the simulation begins with."""
    if lacking := [name for name in NEEDED if getattr(log, name) is None]:
        raise DataError(
            f"simulation from commands: {log.source} holds no {', '.join(lacking)}; record valve "
            "commands and chamber pressures"
        )
    return log


def _ahead(model: Model, runs: Sequence[CommandedRun], horizon: float) -> CommandValidation | None:
    errors, ways, courses = [], [], []
    for run in runs:
        record, samples = run.record, round(horizon / run.step)
        starts = _starts(run, samples)
        if not len(starts):
            continue
        at = starts + np.arange(samples + 1)[:, np.newaxis]  # (T, N)
        assert record.pressure_a is not None and record.pressure_b is not None  # of `_complete`
        state = CraneState(
            record.position[starts],
            record.velocity[starts],
            record.pressure_a[starts],
            record.pressure_b[starts],
        )
        opened = _openings(model, run)[at[:-1]].transpose(0, 2, 1, 3)
        beside = {
            name: values[at] for name in BESIDE if (values := getattr(record, name)) is not None
        }
        position, _ = simulate_openings(model, state, opened, run.step, beside)
        errors.append(position[-1] - record.position[at[-1]])
        ways.append(np.abs(np.diff(record.position[at], axis=0)).sum(axis=0))
        courses.append(_course(run, at, position))
    if not errors:
        return None
    error, way = np.concatenate(errors), np.concatenate(ways)
    rms = np.sqrt((error**2).mean(axis=0))
    return CommandValidation(
        model.joints, horizon, len(error), rms, way.mean(axis=0), tuple(courses)
    )


def _course(run: CommandedRun, at: np.ndarray, position: np.ndarray) -> CommandedCourse:
    """Of positions (T, N, j) at the samples (T, N) of the run."""
    order, joints = at.T.ravel(), position.shape[2]
    simulated = position.copy()
    simulated[-1] = np.nan
    return CommandedCourse(
        source=run.log.source,
        time=run.record.time[order],
        measured=run.record.position[order],
        simulated=simulated.transpose(1, 0, 2).reshape(-1, joints),
    )


def _starts(run: CommandedRun, samples: int) -> np.ndarray:
    """Where consecutive windows begin, in which the commands of all joints are known."""
    starts = np.arange(0, len(run.record) - samples, samples)
    command = run.record.command
    assert command is not None  # of `_complete`
    known = np.isfinite(command.sum(axis=1))
    history = round(HISTORY / run.step)
    sound = [
        start >= history and known[start - history : start + samples].all() for start in starts
    ]
    return starts[np.array(sound, dtype=bool)]


def _openings(model: Model, run: CommandedRun) -> np.ndarray:
    """(n - 1, S, j) from each sample of the record to the next."""
    machine, hydraulics = identified(model)
    record, command = run.record, run.log.command
    assert command is not None  # of `_complete`
    steps = substeps(run.step)
    middle = (np.arange((len(record) - 1) * steps) + 0.5) * run.step / steps
    columns = []
    for j, joint in enumerate(model.joints):
        known = np.isfinite(command.value[:, j])
        sense = float(np.sign(lever_arm(machine, joint, record.position[:1, j]))[0])
        valve = hydraulics.joints[joint].valve
        stamps, commands = command.time[known], command.value[known, j]
        columns.append(valve_openings(valve, sense, stamps, commands, record.time[0] + middle))
    return np.stack(columns, axis=1).reshape(len(record) - 1, steps, -1)
