"""`estimate_positions`: where the crane was, from a bag without some of its encoders."""

import csv
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from crane_model import cli
from crane_model.arguments import between
from crane_model.array import Array, Flags
from crane_model.errors import ConfigurationError
from crane_model.model_file import Model, load_model
from crane_observer.position.replay import EstimatedCourse, replay
from crane_observer.position.sensor import START, PositionSensor
from crane_observer.recording import HeardRecording

TABLE, PICTURE = "positions.csv", "positions.png"
UNKNOWN, LOWER, UPPER = "unknown", "lower", "upper"
CONFIDENCE = 1.96  # standard deviations


def main(argv: Sequence[str] | None = None) -> int:
    """Estimate positions and the load at the tip by pressures, valve commands and the encoders
    that are left; write a table and a picture, with errors where encoders exist.
    """
    parser = cli.command_line(description=main.__doc__)
    parser.add_argument("--bag", type=Path, required=True, help="recording")
    parser.add_argument(
        "--model", type=Path, required=True, help="identified model file, with hydraulics"
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
        recording = HeardRecording.read(arguments.bag, model.joints)
        start = _start(arguments.start, model, recording)
        course = replay(PositionSensor(model, start, arguments.start_deviation), recording, hidden)
        arguments.out.mkdir(parents=True, exist_ok=True)
        reference = _readings(recording, course)
        _write(table, model, course, reference)
        _draw(picture, model, course, reference, hidden)
        _tell(model, course, reference, hidden)
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
    assert model.machine is not None  # the sensor refuses such a model
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


def _write(path: Path, model: Model, course: EstimatedCourse, reference: Array) -> None:
    names = ("position", "velocity", "std_dev", "observable", "encoder")
    units = model.setting.units
    heads = [
        f"{joint}.{name} [{unit}]"
        for joint in model.joints
        for name, unit in zip(
            names, (units[joint], f"{units[joint]}/s", units[joint], "0 or 1", units[joint]),
            strict=True,
        )
    ]  # fmt: skip
    parts = np.stack(
        [course.position, course.velocity, course.deviation, course.observable, reference], axis=2
    )
    with path.open("w", newline="", encoding="utf-8") as file:
        rows = csv.writer(file)
        rows.writerow(["time [s]", *heads, "load [kg]", "load.std_dev [kg]", "condition"])
        for k, time in enumerate(course.time):
            values = [time, *parts[k].ravel(), course.load[k], course.load_deviation[k]]
            rows.writerow([*(f"{value:.6g}" for value in values), course.conditions[k].name])


def _draw(
    path: Path, model: Model, course: EstimatedCourse, reference: Array, hidden: Flags
) -> None:
    from matplotlib.figure import Figure  # a second to import

    joints = len(model.joints)
    figure = Figure(figsize=(9.0, 2.2 * (joints + 1)), layout="constrained")
    axes = figure.subplots(joints + 1, 1, sharex=True)
    for j, joint in enumerate(model.joints):
        unit, scale = ("mm", 1e3) if model.setting.units[joint] == "m" else ("mrad", 1e3)
        around = CONFIDENCE * scale * course.deviation[:, j]
        error = scale * (course.position[:, j] - reference[:, j])
        axes[j].fill_between(course.time, -around, around, color="0.85", label="95 %")
        axes[j].plot(course.time, error, linewidth=0.8, label="estimate − encoder")
        dark = np.where(course.observable[:, j], np.nan, 0.0)
        axes[j].plot(course.time, dark, color="tab:red", linewidth=3, label="not observable")
        axes[j].set_ylabel(f"{joint.replace('_', ' ')}\n[{unit}]")
        axes[j].set_title("without its encoder" if hidden[j] else "with its encoder", fontsize=9)
    axes[0].legend(loc="upper right", fontsize=8)
    low, high = (course.load + sign * CONFIDENCE * course.load_deviation for sign in (-1.0, 1.0))
    axes[-1].fill_between(course.time, low, high, color="0.85")
    axes[-1].plot(course.time, course.load, linewidth=0.8)
    axes[-1].set_ylabel("load [kg]")
    axes[-1].set_ylim(-30.0, max(50.0, 1.2 * float(course.load.max())))
    axes[-1].set_xlabel("time [s]")
    figure.savefig(path, dpi=110)


def _tell(model: Model, course: EstimatedCourse, reference: Array, hidden: Flags) -> None:
    for j, joint in enumerate(model.joints):
        unit = "mm" if model.setting.units[joint] == "m" else "mrad"
        error = 1e3 * (course.position[:, j] - reference[:, j])
        seen = np.isfinite(error)
        rms = f"{np.sqrt(np.mean(error[seen] ** 2)):.2f} {unit}" if seen.any() else "no encoder"
        share = f"{np.mean(course.observable[:, j]):.0%}"
        what = "without encoder" if hidden[j] else "with encoder"
        print(f"{joint:12s} {what:16s} error rms {rms:14s} observable {share} of the time")
    print(f"load         {int(course.changed.sum())} changes, last {course.load[-1]:.1f} kg "
          f"± {course.load_deviation[-1]:.1f} kg")  # fmt: skip
