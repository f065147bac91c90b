"""`estimate_payload`: what hung at the tip in a recording, lift by lift."""

import csv
import sys
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from crane_model import cli
from crane_model.cli import between
from crane_model.errors import DataError
from crane_model.model_file import load_model
from crane_observer.payload.estimator import (
    HEADINGS,
    PAYLOAD_WINDOW,
    PayloadEstimator,
    lifts,
    replay,
)
from crane_observer.recording import HeardRecording

LIFTS, COURSE = "lifts.csv", "load.csv"
COURSE_HEADINGS = (
    "time [s]", "load [kg]", "std_dev [kg]", "centre [m]", "centre.std_dev [m]", "changed",
    "condition",
)  # fmt: skip


class PayloadRequest(NamedTuple):
    """What is asked of `estimate_payload`."""

    bag: Path
    model: Path
    tare: float  # s, NaN: never
    out: Path
    replace: bool


def main(argv: Sequence[str] | None = None) -> int:
    """Estimate the payload in a recording from pressures and encoders; write a log of lifts and
    the payload over time.
    """
    parser = cli.command_line(description=main.__doc__)
    parser.add_argument("--bag", type=Path, required=True, help="recording")
    parser.add_argument("--model", type=Path, required=True, help="identified model file")
    parser.add_argument(
        "--tare",
        type=between(0.0, 1e6),
        default=np.nan,
        metavar="TIME",
        help="time from the first pressures at which the payload counts as zero [s], "
        "best after some seconds of motion",
    )
    parser.add_argument("--out", type=Path, required=True, help="folder for the results")
    cli.add_replace(parser)
    request = PayloadRequest(**vars(parser.parse_args(argv)))
    return cli.run(lambda: _estimate(request))


def _estimate(request: PayloadRequest) -> None:
    log, course = request.out / LIFTS, request.out / COURSE
    cli.check_out(log, course, replace=request.replace)
    estimator = PayloadEstimator(load_model(request.model))
    recording = HeardRecording.read(request.bag, estimator.model.joints)
    for note in recording.notes:
        print(f"warning: {request.bag}: {note}", file=sys.stderr)
    found = replay(estimator, recording, request.tare)
    if not found:
        raise DataError(
            f"{request.bag}: too short for an estimate; a window takes {PAYLOAD_WINDOW:g} s"
        )
    request.out.mkdir(parents=True, exist_ok=True)
    lifted = lifts(found)
    _write(log, HEADINGS, (lift.row() for lift in lifted))
    rows = (
        [*(f"{value:.6g}" for value in (estimate.time, *estimate.load)),
         str(int(estimate.changed)), estimate.condition.name]
        for estimate in found
    )  # fmt: skip
    _write(course, COURSE_HEADINGS, rows)
    for lift in lifted:
        print(f"{lift.picked_up:8.1f} s to {lift.released:8.1f} s: {lift.load.mass:7.1f} kg "
              f"± {lift.load.deviation:.1f} kg, {lift.moved:.1f} s of motion")  # fmt: skip
    last = found[-1]
    print(f"{len(lifted)} lifts; at the end {last.load.mass:.1f} kg "
          f"± {last.load.deviation:.1f} kg, {last.condition.value}")  # fmt: skip
    print(f"written: {log}, {course}")


def _write(path: Path, headings: Sequence[str], rows: Iterable[Sequence[str]]) -> None:
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(headings)
        writer.writerows(rows)
