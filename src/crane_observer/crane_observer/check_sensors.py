"""`check_sensors`: which sensor lies in a recording, and whether it is fit for identification."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from crane_model import cli
from crane_model.configuration import load, save
from crane_model.errors import ConfigurationError, DataError
from crane_model.model_file import Model, load_model
from crane_observer.monitor.picture import draw
from crane_observer.monitor.replay import Heed, WatchedBag, watch
from crane_observer.monitor.tolerance import APART, Tolerance, learn


def main(argv: Sequence[str] | None = None) -> int:
    """Look for sensors that lie, and valves that do not do what they are told, in recordings; by an
    identified model. The exit status is 1 if one is not fit for identification.
    """
    parser = cli.command_line(description=main.__doc__)
    add = parser.add_argument
    add("--bag", type=Path, nargs="+", required=True, help="recordings")
    add("--model", type=Path, required=True, help="identified model file, with hydraulics")
    add("--tolerance", type=Path, help="file that --learn wrote (default: a wide tolerance)")
    add(
        "--learn",
        type=Path,
        metavar="FILE",
        help="nothing is wrong in these recordings: learn from them how far the model is off on "
        "this machine, and write it to a new file",
    )
    add("--picture", type=Path, help="new file (png, pdf, svg): residuals of the first recording")
    arguments = parser.parse_args(argv)
    if arguments.learn and (arguments.tolerance or arguments.picture):
        parser.error("--learn: goes with neither --tolerance nor --picture")

    def body() -> None:
        model = load_model(arguments.model)
        if model.hydraulics is None and (arguments.learn or arguments.picture):
            raise ConfigurationError(
                f"{arguments.model}: holds no hydraulics, so that nothing is compared: there is no "
                "tolerance to learn and no picture; identify hydraulics with `identify`"
            )
        if arguments.learn:
            _learn(model, arguments.bag, arguments.learn)
            return
        if arguments.picture:
            cli.check_out(arguments.picture)
        tolerance = load(arguments.tolerance, Tolerance) if arguments.tolerance else None
        if model.hydraulics is None:
            print(f"hydraulics: none. {Heed.ALONE.value}")
        elif tolerance is None:
            print("tolerance: assumed, and wide; learn one from good recordings with --learn")
        seen = [watch(bag, model, tolerance) for bag in arguments.bag]
        for one in seen:
            print("\n".join(_lines(one)))
        if arguments.picture:
            draw(seen[0], arguments.picture)
            print(f"written: {arguments.picture}")
        if unfit := [str(one.bag) for one in seen if one.findings]:
            raise DataError(
                f"{', '.join(unfit)}: not fit for identification; mend what is named above and "
                "record again, or identify with --to up to its onset"
            )

    return cli.run(body)


def _learn(model: Model, bags: Sequence[Path], file: Path) -> None:
    if file.exists():
        raise ConfigurationError(f"{file}: is there already; name a new file")
    sums = [watch(bag, model, None).sums for bag in bags]
    names = ", ".join(bag.name for bag in bags)
    tolerance = learn(model.joints, sums, f"learnt from {names}")
    save(file, tolerance)
    minutes = sum(np.ptp(one.time) for one in sums) / 60.0
    print(f"written: {file}, from {minutes:.1f} minutes")
    print(
        f"an alarm takes {tolerance.level:.0%} of a tolerance: as these recordings tell, a machine "
        f"without a fault does so once in {APART:g} hours"
    )


def _lines(seen: WatchedBag) -> list[str]:
    verdict = "not fit for identification" if seen.findings else "fit for identification"
    lines = [f"{seen.bag}: {verdict}", *(f"  {one}" for one in seen.findings)]
    if not seen.findings and len(seen.sums.time):
        lines.append(f"  the nearest to an alarm took {seen.largest:.0%} of its tolerance")
    if seen.refused:
        lines.append(f"  {seen.refused} samples not used, the last: {seen.why_not}")
    return [*lines, *(f"  {note}" for note in seen.notes)]
