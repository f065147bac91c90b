"""Simulated against measured motion, from pressures or from valve commands.

The second comparison beside predicted against measured force: from the measured state, driven by
the measured pressures, the model moves on its own for the horizon, again and again over the record.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from crane_identification.data.log import Log
from crane_identification.options import Options
from crane_identification.preparation.prepare import prepare
from crane_model.cylinders import cylinder_force, cylinder_forces_from_generalized, lever_arm
from crane_model.errors import CraneError, DataError, RangeError
from crane_model.hydraulics.simulation import (
    CraneState,
    identified,
    simulate_openings,
    simulated_circuit,
    substeps,
    valve_openings,
)
from crane_model.model_file import Model
from crane_model.record import Record
from crane_model.simulation import simulate

HORIZON = 0.5  # s
COMMAND_SIGNALS = (
    *("time", "run", "pressure_a", "pressure_b", "command", "temperature"),
    *("slew_position", "slew_velocity", "slew_acceleration"),
)
"""Fields of a record that do not come out of the simulation and that terms may ask for."""
HORIZONS = (1.0, 5.0)  # s ahead
BESIDE = ("run", "slew_position", "slew_velocity", "slew_acceleration", "temperature")
NEEDED_SIGNALS = ("command", "pressure_a", "pressure_b")
HISTORY = 0.5  # s of commands before a window, after which the spool has forgotten what was before


@dataclass(frozen=True)
class MotionValidation:
    """Errors of simulated motion over N windows of `horizon` [s]; per joint (j,), rad or m.

    `position_rms` is the error at the end of the horizon, `path` how far the joint itself
    moved by then (rms), `relative` their ratio. Where the model cannot be simulated, `reason` says
    why, there is no window and the errors are NaN.
    """

    joints: tuple[str, ...]
    horizon: float
    windows: int
    position_rms: np.ndarray
    path: np.ndarray
    reason: str = ""

    @property
    def relative(self) -> np.ndarray:
        """Error over path, (j,); NaN where the joint does not move."""
        with np.errstate(invalid="ignore", divide="ignore"):
            return np.asarray(self.position_rms / self.path)


def validate_motion(model: Model, records: Sequence[Record]) -> MotionValidation:
    """Simulate `model` over consecutive windows of uniformly sampled `records`.

    Windows do not cross from one run to the next. A model that does not move, as one without
    inertia, or that moves beyond all bounds, and records without a window or a drive, lose this
    comparison alone: it comes with the reason.
    """
    try:
        with np.errstate(over="ignore", invalid="ignore"):
            found = _simulated(model, records)
        if np.isfinite(found.position_rms).all():
            return found
        reason = f"simulation of '{model.name}': the motion grows beyond all bounds"
    except (RangeError, DataError) as error:
        reason = str(error)
    unknown = np.full(len(model.joints), np.nan)
    return MotionValidation(model.joints, HORIZON, 0, unknown, unknown, reason)


def _simulated(model: Model, records: Sequence[Record]) -> MotionValidation:
    errors, moved, length = [], [], HORIZON
    for record in records:
        period = float(np.median(np.diff(record.time)))
        samples = max(round(HORIZON / period), 1)
        starts = _window_starts(record, samples)
        if len(starts) == 0:
            continue
        at = starts[None, :] + np.arange(samples + 1)[:, None]  # (T, N)
        start = record.position[starts], record.velocity[starts]
        motion = simulate(
            model,
            *start,
            _drive(model, record)[at],
            period,
            beside=_logged(record, at),
            memory={term: term.trace(record, model.setting)[starts] for term in model.terms},
        )
        errors.append(motion.position[-1] - record.position[at[-1]])
        moved.append(record.position[at[-1]] - record.position[starts])
        length = samples * period
    if not errors:
        raise DataError(
            f"simulated motion: no window of {HORIZON} s fits into a run of the recordings; "
            "record longer ones"
        )
    error, displacement = np.concatenate(errors), np.concatenate(moved)
    return MotionValidation(model.joints, length, len(error), _rms(error), _rms(displacement))


def _logged(record: Record, at: np.ndarray) -> dict[str, np.ndarray]:
    """(T, N, ...) of what the record holds of these, at its samples `at` (T, N)."""
    values = {name: getattr(record, name) for name in COMMAND_SIGNALS}
    return {name: value[at] for name, value in values.items() if value is not None}


def _window_starts(record: Record, length: int) -> np.ndarray:
    run = np.zeros(len(record), dtype=int) if record.run is None else record.run
    starts = np.arange(0, len(record) - length, length)
    return starts[run[starts] == run[starts + length]]


def _drive(model: Model, record: Record) -> np.ndarray:
    """Cylinder forces [N] where the model has linkages, generalized forces where not: (n, j)."""
    if model.machine is not None and record.pressure_a is not None:
        assert record.pressure_b is not None  # logged together
        pairs = zip(record.joints, record.pressure_a.T, record.pressure_b.T, strict=True)
        return np.stack([cylinder_force(model.machine, *pair) for pair in pairs], axis=1)
    if record.force is None:
        raise DataError("simulated motion: the record has neither pressures nor forces to drive it")
    if model.machine is None:
        return record.force
    return cylinder_forces_from_generalized(
        model.machine, record.position, record.force, record.joints
    )


def _rms(error: np.ndarray) -> np.ndarray:
    return np.sqrt((error**2).mean(axis=0))


# Simulated against measured motion from the valve commands alone: the whole crane, open loop.


class CommandedCourse(NamedTuple):
    """Measured and simulated position (n, j) [rad, m] at time (n,) [s] of all windows of a run, one
    behind the other; NaN where one ends and the next begins at the measured state.
    """

    source: str
    time: np.ndarray
    measured: np.ndarray
    simulated: np.ndarray


@dataclass(frozen=True)
class CommandValidation(MotionValidation):
    """The same from valve commands; `path` is the mean length of the way of a joint, and `courses`
    are those of each run.
    """

    courses: tuple[CommandedCourse, ...] = ()


def validate_commands(
    model: Model, logs: Sequence[Log], options: Options | None = None
) -> tuple[CommandValidation, ...]:
    """Simulate `model` over consecutive windows of `logs`, for each of HORIZONS that fits.

    `ConfigurationError` if the model has no values or no hydraulics, `DataError` if the recordings
    hold no commands or pressures, or no window.
    """
    simulated_circuit(model)  # says what is not identified, before any recording is prepared
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
    found = [ahead for ahead in (_ahead(model, runs, horizon) for horizon in HORIZONS) if ahead]
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
    if lacking := [name for name in NEEDED_SIGNALS if getattr(log, name) is None]:
        raise DataError(
            f"simulation from commands: {log.source} holds no {', '.join(lacking)}; record valve "
            "commands and chamber pressures"
        )
    return log


def _ahead(model: Model, runs: Sequence[CommandedRun], horizon: float) -> CommandValidation | None:
    errors, paths, courses = [], [], []
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
        paths.append(np.abs(np.diff(record.position[at], axis=0)).sum(axis=0))
        courses.append(_course(run, at, position))
    if not errors:
        return None
    error, path = np.concatenate(errors), np.concatenate(paths)
    return CommandValidation(
        model.joints, horizon, len(error), _rms(error), path.mean(axis=0), courses=tuple(courses)
    )


def _course(run: CommandedRun, at: np.ndarray, position: np.ndarray) -> CommandedCourse:
    """Course of positions (T, N, j) at the samples (T, N) of the run."""
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
    """Starts of consecutive windows in which the commands of all joints are known."""
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
