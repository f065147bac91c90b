"""`check_sensors`: which sensor is faulty in a recording; is it fit for identification?"""

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from crane_model import cli
from crane_model.configuration import load, save
from crane_model.errors import ConfigurationError, DataError
from crane_model.model_file import Model, load_model
from crane_observer.monitor.replay import Heed, WatchedBag, draw, watch
from crane_observer.monitor.tolerance import HOURS_PER_FALSE_ALARM, Tolerance, learn, unlearnt


class SensorRequest(NamedTuple):
    """Request of `check_sensors`."""

    bag: list[Path]
    model: Path
    tolerance: Path | None
    learn: Path | None
    picture: Path | None


def main(argv: Sequence[str] | None = None) -> int:
    """Find faulty sensors, and valves that do not follow their commands, in recordings, by an
    identified model. The exit status is 1 if a recording is not fit for identification.
    """
    parser = cli.command_line(description=main.__doc__)
    add = parser.add_argument
    add("--bag", type=Path, nargs="+", required=True, help="recordings")
    add("--model", type=Path, required=True, help="identified model file, with hydraulics")
    add("--tolerance", type=Path, help="tolerance file from --learn (default: a wide tolerance)")
    add(
        "--learn",
        type=Path,
        metavar="FILE",
        help="new file for the tolerance of this machine, learned from these "
        "recordings, which must be free of faults",
    )
    add(
        "--picture",
        type=Path,
        help="new picture of the residuals of the first recording (png, pdf, svg)",
    )
    request = SensorRequest(**vars(parser.parse_args(argv)))
    if request.learn and (request.tolerance or request.picture):
        parser.error("--learn: goes with neither --tolerance nor --picture")
    return cli.run(lambda: _check(request))


def _check(request: SensorRequest) -> None:
    model = load_model(request.model)
    if model.hydraulics is None and (request.learn or request.picture):
        raise ConfigurationError(
            f"{request.model}: holds no hydraulics, so that nothing is compared: there is no "
            "tolerance to learn and no picture; identify hydraulics with `identify`"
        )
    if request.learn:
        _learn(model, request.bag, request.learn)
        return
    if request.picture:
        cli.check_out(request.picture)
    tolerance = load(request.tolerance, Tolerance) if request.tolerance else None
    if model.hydraulics is None:
        print(f"hydraulics: none. {Heed.ALONE.value}")
    elif tolerance is None and model.machine and model.machine.hydraulics.load_sensing:
        print(f"tolerance: none. {Heed.UNLEARNT.value}")
    elif tolerance is None:
        print("tolerance: assumed, and wide; learn one from good recordings with --learn")
    watched = [watch(bag, model, tolerance) for bag in request.bag]
    for seen in watched:
        print("\n".join(_lines(seen)))
    if request.picture:
        draw(watched[0], request.picture)
        print(f"written: {request.picture}")
    if unfit := [str(seen.bag) for seen in watched if seen.findings]:
        raise DataError(
            f"{', '.join(unfit)}: not fit for identification; repair what is named above and "
            "record again, or identify with --to up to its onset"
        )


def _learn(model: Model, bags: Sequence[Path], file: Path) -> None:
    if file.exists():
        raise ConfigurationError(f"{file}: is there already; name a new file")
    sums = [watch(bag, model, unlearnt(model.joints)).sums for bag in bags]
    names = ", ".join(bag.name for bag in bags)
    tolerance = learn(model.joints, sums, f"learnt from {names}")
    save(file, tolerance)
    minutes = sum(np.ptp(recording.time) for recording in sums) / 60.0
    print(f"written: {file}, from {minutes:.1f} minutes")
    print(
        f"an alarm begins at {tolerance.level:.0%} of the tolerance, and at less with a longer "
        f"recording: expect one false alarm in {HOURS_PER_FALSE_ALARM:g} hours"
    )


def _lines(seen: WatchedBag) -> list[str]:
    verdict = "not fit for identification" if seen.findings else "fit for identification"
    lines = [f"{seen.bag}: {verdict}", *(f"  {finding}" for finding in seen.findings)]
    if not seen.findings and len(seen.sums.time):
        lines.append(f"  the nearest to an alarm took {seen.largest:.0%} of its tolerance")
    if seen.refused:
        lines.append(f"  {seen.refused} samples not used, the last: {seen.why_not}")
    return [*lines, *(f"  {note}" for note in seen.notes)]
