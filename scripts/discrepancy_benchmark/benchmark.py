"""make discrepancy-benchmark: does `diagnose` find what is hidden in the stand-in machine?

One process makes bags of machines that hide effects, a second one answers from the bags alone, a
third opens the labels and scores. What is finished is kept, so that an interrupted run goes on
where it was; thresholds and code should not change in between.
"""

import argparse
import os
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

import freeze
from cases import CaseSet
from folders import Folders, done

from crane_model import cli

HERE = Path(__file__).resolve().parent
COUNTS = {CaseSet.TUNING: 40, CaseSet.CALIBRATION: 60, CaseSet.SCORING: 140}
BATCH = 8  # cases whose bags are on the disk at once, 1 GB


def run(arguments: argparse.Namespace) -> None:
    """All stages, batch by batch; raises `CraneError` with what is wrong."""
    which: CaseSet = arguments.which
    count = COUNTS[which] if arguments.cases is None else arguments.cases
    top: Path = arguments.out / which.value
    thresholds: Path | None = None
    if which is CaseSet.SCORING:
        top /= freeze.require_frozen()[:12]
        if Folders(top).results.exists():
            print(f"scored already with these thresholds, which is done once: {top}/results.json")
            stage("score_cases", top, arguments.workers)
            return
    folders = Folders(top)
    top.mkdir(parents=True, exist_ok=True)
    if which is CaseSet.CALIBRATION:
        thresholds = top / "open.yaml"
        freeze.write_open(thresholds)
    beside = () if thresholds is None else ("--thresholds", thresholds)
    keep = ("--keep-bags",) if arguments.keep_bags else ()
    quick = ("--quick",) if arguments.quick else ()
    for first in range(0, count, BATCH):
        last = min(first + BATCH, count)
        stage(
            *("make_cases", top, arguments.workers, "--set", which.value, "--count", count),
            *("--from", first, "--to", last, "--sets", arguments.sets, *quick),
        )
        stage("answer_cases", top, arguments.workers, *beside, *keep)
        print(f"{len(done(folders.answers))} of {count} cases answered", flush=True)
    if which is CaseSet.CALIBRATION:
        found = freeze.freeze(folders) if arguments.freeze else freeze.calibrated(folders)
        print("\n".join(freeze.lines(found)))
        return
    stage("score_cases", top, arguments.workers)


def stage(script: str, folder: Path, workers: int, *arguments: object) -> None:
    """Run a stage as a process of its own; the benchmark ends with its status if it fails."""
    command = [sys.executable, HERE / f"{script}.py", "--folder", folder, "--workers", workers]
    done_ = subprocess.run([*map(str, command), *map(str, arguments)])
    if done_.returncode:
        raise SystemExit(done_.returncode)


def main(argv: Sequence[str] | None = None) -> int:
    """Run the benchmark; exit status 1 if thresholds are not frozen or a stage fails."""
    parser = argparse.ArgumentParser(prog="benchmark", description=__doc__.splitlines()[0])
    add = parser.add_argument
    add("--set", type=CaseSet, choices=list(CaseSet), default=CaseSet.SCORING, dest="which")
    add("--cases", type=int, help=", ".join(f"{n} ({s.value})" for s, n in COUNTS.items()))
    add("--sets", type=int, default=2, help="of three recordings to train on, in each case")
    add("--quick", action="store_true", help="one short recording each: to try the machinery")
    add("--workers", type=int, default=os.cpu_count() or 1, help="processes")
    add("--out", type=Path, default=Path("runs/discrepancy_benchmark"), help="folder")
    add("--keep-bags", action="store_true", help="100 MB a case; to answer again")
    add("--freeze", action="store_true", help="write the calibrated thresholds to the package")
    arguments = parser.parse_args(argv)
    return cli.run(lambda: run(arguments))


if __name__ == "__main__":
    sys.exit(main())
