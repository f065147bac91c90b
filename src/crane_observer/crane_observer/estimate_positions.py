"""`estimate_positions`: where the crane was, from a bag without some of its encoders."""

import csv
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from crane_model import cli
from crane_model.array import Array, Flags
from crane_model.cli import between
from crane_model.errors import ConfigurationError
from crane_model.model_file import Model, load_model
from crane_observer.position.estimator import START_DEVIATION, PositionEstimator
from crane_observer.position.filter import refuse_unserved
from crane_observer.position.replay import EstimatedCourse, draw, replay_smoothed
from crane_observer.recording import HeardRecording

TABLE, PICTURE = "positions.csv", "positions.png"
UNKNOWN, LOWER, UPPER = "unknown", "lower", "upper"


class PositionRequest(NamedTuple):
    """Request of `estimate_positions`."""

    bag: Path
    model: Path
    without: list[str]
    start: list[str]
    start_deviation: float
    out: Path
    replace: bool


class Estimates(NamedTuple):
    """Estimates of a recording, and readings of the encoders."""

    model: Model
    course: EstimatedCourse
    smoothed: EstimatedCourse
    reference: Array  # (n, j) of the encoders at the times of the course; NaN where there are none
    hidden: Flags  # (j,) whose encoders were not used


def main(argv: Sequence[str] | None = None) -> int:
    """Estimate positions and payload from pressures, valve commands and the remaining encoders:
    as the node does, and smoothed. Write a table and a picture, with errors where encoders exist.
    """
    parser = cli.command_line(description=main.__doc__)
    parser.add_argument("--bag", type=Path, required=True, help="recording")
    parser.add_argument(
        "--model", type=Path, required=True, help="identified model file, best with hydraulics"
    )
    parser.add_argument(
        "--without",
        nargs="+",
        default=[],
        metavar="JOINT",
        help="joints whose encoders are not used",
    )
    parser.add_argument(
        "--start",
        nargs="+",
        default=[],
        metavar="JOINT=POSITION",
        help="initial position of a joint without encoder [rad, m]: a number, "
        f"'{LOWER}', '{UPPER}' or '{UNKNOWN}' (default: its first reading, if recorded)",
    )
    parser.add_argument(
        "--start-deviation",
        type=between(1e-5, 1.0),
        default=START_DEVIATION,
        metavar="DEVIATION",
        help="standard deviation of a known initial position [rad, m] "
        f"(default: {START_DEVIATION:g})",
    )
    parser.add_argument("--out", type=Path, required=True, help="folder for the results")
    cli.add_replace(parser)
    request = PositionRequest(**vars(parser.parse_args(argv)))
    return cli.run(lambda: _estimate(request))


def _estimate(request: PositionRequest) -> None:
    table, picture = request.out / TABLE, request.out / PICTURE
    cli.check_out(table, picture, replace=request.replace)
    model = load_model(request.model)
    hidden = np.isin(model.joints, _joints(request.without, model))
    for warning in refuse_unserved(model, hidden):
        print(f"warning: {warning}", file=sys.stderr)
    recording = HeardRecording.read(request.bag, model.joints)
    for note in recording.notes:
        print(f"warning: {request.bag}: {note}", file=sys.stderr)
    start = _start(request.start, model, recording)
    estimator = PositionEstimator(model, start, request.start_deviation)
    course, smoothed = replay_smoothed(estimator, recording, hidden)
    request.out.mkdir(parents=True, exist_ok=True)
    found = Estimates(model, course, smoothed, _reference(recording, course), hidden)
    _write(table, found)
    draw(picture, *found)
    _tell(found)
    print(f"written: {table}, {picture}")


def _joints(names: Sequence[str], model: Model) -> Sequence[str]:
    if unknown := [name for name in names if name not in model.joints]:
        raise ConfigurationError(
            f"no joint {', '.join(unknown)}; the model has {', '.join(model.joints)}"
        )
    return names


def _start(given: Sequence[str], model: Model, recording: HeardRecording) -> Array:
    """(j,) NaN where it is not known."""
    start = np.full(len(model.joints), np.nan)
    if len(recording.encoders):
        start = recording.encoders[0].copy()
    assert model.machine is not None  # else it would have been refused
    for entry in given:
        joint, _, text = entry.partition("=")
        _joints([joint], model)
        limits = model.machine.limits[joint]
        words = {LOWER: limits.position_min, UPPER: limits.position_max, UNKNOWN: np.nan}
        try:
            value = words[text] if text in words else float(text)
        except ValueError:
            raise ConfigurationError(
                f"--start {entry}: must be JOINT=NUMBER, {LOWER}, {UPPER} or {UNKNOWN}"
            ) from None
        if not np.isnan(value) and not limits.position_min <= value <= limits.position_max:
            raise ConfigurationError(
                f"--start {entry}: {joint} moves from {limits.position_min} to "
                f"{limits.position_max} {model.setting.units[joint]}"
            )
        start[model.joints.index(joint)] = value
    return start


def _reference(recording: HeardRecording, course: EstimatedCourse) -> Array:
    found = np.full_like(course.position, np.nan)
    for j, shown in enumerate(recording.encoders.T):
        valid = np.isfinite(shown)
        if valid.sum() > 1:
            found[:, j] = np.interp(course.time, recording.encoder_time[valid], shown[valid])
    return found


def _write(path: Path, found: Estimates) -> None:
    course, smoothed = found.course, found.smoothed
    of_joints = {
        "position": course.position,
        "velocity": course.velocity,
        "std_dev": course.deviation,
        "observable": course.observable,
        "encoder": found.reference,
        "smoothed": smoothed.position,
        "smoothed_velocity": smoothed.velocity,
        "smoothed_std_dev": smoothed.deviation,
    }
    of_load = {
        "load": course.load,
        "load.std_dev": course.load_deviation,
        "load.smoothed": smoothed.load,
        "load.smoothed_std_dev": smoothed.load_deviation,
    }
    heads = []
    for joint in found.model.joints:
        unit = found.model.setting.units[joint]
        special = {"observable": "0 or 1"}
        special |= dict.fromkeys(("velocity", "smoothed_velocity"), f"{unit}/s")
        heads += [f"{joint}.{name} [{special.get(name, unit)}]" for name in of_joints]
    parts = np.stack(list(of_joints.values()), axis=2)
    with path.open("w", newline="", encoding="utf-8") as file:
        rows = csv.writer(file)
        rows.writerow(["time [s]", *heads, *(f"{name} [kg]" for name in of_load), "condition"])
        for k, time in enumerate(course.time):
            values = [time, *parts[k].ravel(), *(column[k] for column in of_load.values())]
            rows.writerow([*(f"{value:.6g}" for value in values), course.conditions[k].name])


def _tell(found: Estimates) -> None:
    course, smoothed, reference = found.course, found.smoothed, found.reference
    for j, joint in enumerate(found.model.joints):
        unit = "mm" if found.model.setting.units[joint] == "m" else "mrad"
        seen = np.isfinite(reference[:, j])
        told = "no encoder"
        if seen.any():
            error, later = (
                1e3 * np.sqrt(np.mean((estimate.position - reference)[seen, j] ** 2))
                for estimate in (course, smoothed)
            )
            told = f"error rms {error:.2f} {unit}, smoothed {later:.2f} {unit}"
        share = f"{np.mean(course.observable[:, j]):.0%}"
        what = "without encoder" if found.hidden[j] else "with encoder"
        print(f"{joint:12s} {what:16s} {told:42s} observable {share} of the time")
    print(f"load         {int(course.changed.sum())} changes, last {course.load[-1]:.1f} kg "
          f"± {course.load_deviation[-1]:.1f} kg")  # fmt: skip
