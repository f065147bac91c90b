"""`estimate_positions`: where the crane was, from a bag without some of its encoders."""

import csv
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from crane_model import cli
from crane_model.array import Array, Flags
from crane_model.cli import between
from crane_model.errors import ConfigurationError
from crane_model.model_file import Model, load_model
from crane_observer.position.hypotheses import refuse_unserved
from crane_observer.position.picture import draw
from crane_observer.position.replay import EstimatedCourse, replay_smoothed
from crane_observer.position.sensor import START, PositionSensor
from crane_observer.recording import HeardRecording

TABLE, PICTURE = "positions.csv", "positions.png"
COLUMNS = (
    "position", "velocity", "std_dev", "observable", "encoder", "smoothed", "smoothed_velocity",
    "smoothed_std_dev",
)  # fmt: skip
UNKNOWN, LOWER, UPPER = "unknown", "lower", "upper"


def main(argv: Sequence[str] | None = None) -> int:
    """Estimate positions and the load at the tip by pressures, valve commands and the encoders
    that are left, as the node does, and smoothed, with all that came later; write a table and a
    picture, with errors where encoders exist.
    """
    parser = cli.command_line(description=main.__doc__)
    parser.add_argument("--bag", type=Path, required=True, help="recording")
    parser.add_argument(
        "--model", type=Path, required=True, help="identified model file, best with hydraulics"
    )
    parser.add_argument(
        "--without", nargs="+", default=[], metavar="JOINT", help="whose encoders are not used"
    )
    parser.add_argument(
        "--start",
        nargs="+",
        default=[],
        metavar="JOINT=POSITION",
        help=f"where a joint without encoder starts [rad, m], its end '{LOWER}' or '{UPPER}', or "
        f"'{UNKNOWN}' (default: its first reading, where the bag has one)",
    )
    parser.add_argument(
        "--start-deviation",
        type=between(1e-5, 1.0),
        default=START,
        metavar="DEVIATION",
        help=f"standard deviation of a known start [rad, m] (default: {START:g})",
    )
    parser.add_argument("--out", type=Path, required=True, help="folder for the results")
    cli.add_replace(parser)
    arguments = parser.parse_args(argv)

    def body() -> None:
        table, picture = arguments.out / TABLE, arguments.out / PICTURE
        cli.check_out(table, picture, replace=arguments.replace)
        model = load_model(arguments.model)
        hidden = np.isin(model.joints, _joints(arguments.without, model))
        for warning in refuse_unserved(model, hidden):
            print(f"warning: {warning}", file=sys.stderr)
        recording = HeardRecording.read(arguments.bag, model.joints)
        for note in recording.notes:
            print(f"warning: {arguments.bag}: {note}", file=sys.stderr)
        start = _start(arguments.start, model, recording)
        sensor = PositionSensor(model, start, arguments.start_deviation)
        course, smoothed = replay_smoothed(sensor, recording, hidden)
        arguments.out.mkdir(parents=True, exist_ok=True)
        reference = _readings(recording, course)
        _write(table, model, course, smoothed, reference)
        draw(picture, model, course, smoothed, reference, hidden)
        _tell(model, course, smoothed, reference, hidden)
        print(f"written: {table}, {picture}")

    return cli.run(body)


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


def _readings(recording: HeardRecording, course: EstimatedCourse) -> Array:
    """(n, j) of the encoders at the times of the course; NaN where there are none."""
    found = np.full_like(course.position, np.nan)
    for j in range(recording.encoders.shape[1]):
        valid = np.isfinite(recording.encoders[:, j])
        if valid.sum() > 1:
            found[:, j] = np.interp(
                course.time, recording.encoder_time[valid], recording.encoders[valid, j]
            )
    return found


def _write(
    path: Path, model: Model, course: EstimatedCourse, smoothed: EstimatedCourse, reference: Array
) -> None:
    heads = []
    for joint in model.joints:
        unit = model.setting.units[joint]
        units = dict.fromkeys(("position", "std_dev", "encoder", "smoothed"), unit)
        units |= {"velocity": f"{unit}/s", "observable": "0 or 1", "smoothed_std_dev": unit}
        units["smoothed_velocity"] = f"{unit}/s"
        heads += [f"{joint}.{name} [{units[name]}]" for name in COLUMNS]
    parts = np.stack(
        [
            course.position, course.velocity, course.deviation, course.observable, reference,
            smoothed.position, smoothed.velocity, smoothed.deviation,
        ],
        axis=2,
    )  # fmt: skip
    loads = [course.load, course.load_deviation, smoothed.load, smoothed.load_deviation]
    names = ("load", "load.std_dev", "load.smoothed", "load.smoothed_std_dev")
    with path.open("w", newline="", encoding="utf-8") as file:
        rows = csv.writer(file)
        rows.writerow(["time [s]", *heads, *(f"{name} [kg]" for name in names), "condition"])
        for k, time in enumerate(course.time):
            values = [time, *parts[k].ravel(), *(one[k] for one in loads)]
            rows.writerow([*(f"{value:.6g}" for value in values), course.conditions[k].name])


def _tell(
    model: Model, course: EstimatedCourse, smoothed: EstimatedCourse, reference: Array,
    hidden: Flags,
) -> None:  # fmt: skip
    for j, joint in enumerate(model.joints):
        unit = "mm" if model.setting.units[joint] == "m" else "mrad"
        seen = np.isfinite(reference[:, j])
        error, later = (
            np.sqrt(np.mean((one.position - reference)[seen, j] ** 2)) if seen.any() else np.nan
            for one in (course, smoothed)
        )
        found = f"error rms {1e3 * error:.2f} {unit}, smoothed {1e3 * later:.2f} {unit}"
        share = f"{np.mean(course.observable[:, j]):.0%}"
        what = "without encoder" if hidden[j] else "with encoder"
        told = found if seen.any() else "no encoder"
        print(f"{joint:12s} {what:16s} {told:42s} observable {share} of the time")
    print(f"load         {int(course.changed.sum())} changes, last {course.load[-1]:.1f} kg "
          f"± {course.load_deviation[-1]:.1f} kg")  # fmt: skip
