"""`weigh`: what hung at the tip in a recording, lift by lift."""

import csv
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from crane_model import cli
from crane_model.cli import between
from crane_model.errors import DataError
from crane_model.model_file import load_model
from crane_observer.recording import HeardRecording
from crane_observer.scale.scale import HEADINGS, Lift, Scale, Weighing, lifts, row_of, weigh

LIFTS, COURSE = "lifts.csv", "load.csv"


def main(argv: Sequence[str] | None = None) -> int:
    """Weigh the load at the tip in a recording by pressures and encoders; write a log of lifts and
    the load over time.
    """
    parser = cli.command_line(description=main.__doc__)
    parser.add_argument("--bag", type=Path, required=True, help="recording")
    parser.add_argument("--model", type=Path, required=True, help="identified model file")
    parser.add_argument(
        "--tare",
        type=between(0.0, 1e6),
        default=np.nan,
        metavar="TIME",
        help="s after the first pressures: what hangs at the tip then counts as nothing, best "
        "after some seconds of motion",
    )
    parser.add_argument("--out", type=Path, required=True, help="folder for the results")
    cli.add_replace(parser)
    arguments = parser.parse_args(argv)

    def body() -> None:
        log, course = arguments.out / LIFTS, arguments.out / COURSE
        cli.check_out(log, course, replace=arguments.replace)
        scale = Scale(load_model(arguments.model))
        recording = HeardRecording.read(arguments.bag, scale.model.joints)
        for note in recording.notes:
            print(f"warning: {arguments.bag}: {note}", file=sys.stderr)
        found = weigh(scale, recording, arguments.tare)
        if not found:
            raise DataError(f"{arguments.bag}: too short to weigh; a window takes 0.3 s")
        arguments.out.mkdir(parents=True, exist_ok=True)
        lifted = lifts(found)
        _write_lifts(log, lifted)
        _write_course(course, found)
        for one in lifted:
            print(f"{one.picked_up:8.1f} s to {one.released:8.1f} s: {one.load.mass:7.1f} kg "
                  f"± {one.load.deviation:.1f} kg, {one.moved:.1f} s of motion")  # fmt: skip
        last = found[-1]
        print(f"{len(lifted)} lifts; at the end {last.load.mass:.1f} kg "
              f"± {last.load.deviation:.1f} kg, {last.condition.value}")  # fmt: skip
        print(f"written: {log}, {course}")

    return cli.run(body)


def _write_lifts(path: Path, lifted: Sequence[Lift]) -> None:
    with path.open("w", newline="", encoding="utf-8") as file:
        rows = csv.writer(file)
        rows.writerow(HEADINGS)
        rows.writerows(row_of(one) for one in lifted)


def _write_course(path: Path, found: Sequence[Weighing]) -> None:
    with path.open("w", newline="", encoding="utf-8") as file:
        rows = csv.writer(file)
        rows.writerow(["time [s]", "load [kg]", "std_dev [kg]", "centre [m]", "centre.std_dev [m]",
                       "changed", "condition"])  # fmt: skip
        for one in found:
            numbers = (f"{value:.6g}" for value in (one.time, *one.load))
            rows.writerow([*numbers, int(one.changed), one.condition.name])
