"""make discrepancy-benchmark: does `diagnose` find what is hidden in the stand-in machine?

One process makes bags of machines that hide effects, a second one answers from the bags alone, a
third opens the labels and scores. What is finished is kept, so that an interrupted run goes on
where it was; code should not change in between. Bags do not depend on thresholds: they may be made
ahead, and serve for the next thresholds too if they are kept.
"""

import argparse
import os
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

from crane_benchmark.cases.case_sets import CaseSet
from crane_benchmark.folders import Folders, done
from crane_benchmark.scores import freeze, frozen
from crane_model import cli

STAGES = {
    "make_cases": "crane_benchmark.cases.make_cases",
    "answer_cases": "crane_benchmark.answers.answer_cases",
    "score_cases": "crane_benchmark.scores.score_cases",
}
COUNTS = {
    CaseSet.TUNING: 40,
    CaseSet.CALIBRATION: 40,
    CaseSet.SCORING: 96,
    CaseSet.FORMER: 96,
    CaseSet.STRANGERS: 12,
    CaseSet.AWAY: 60,
    CaseSet.AWAY_CLEAN: 40,
}
CLEAN = (CaseSet.CALIBRATION, CaseSet.AWAY_CLEAN)
BATCH = 8  # cases whose bags are on the disk at once, 1 GB


def run(arguments: argparse.Namespace) -> None:
    """All stages, batch by batch; raises `CraneError` with what is wrong."""
    which: CaseSet = arguments.which
    count: int = arguments.cases
    top: Path = arguments.out / which.value
    if arguments.bags_only:
        make(arguments, Folders(top), 0, count)
        return
    calibrating = which is CaseSet.CALIBRATION or arguments.gates is not None
    folders = Folders(top, name_of_round(arguments))
    if which is CaseSet.SCORING and folders.results.exists():
        print(f"scored already with these thresholds, which is done once: {folders.results}")
        stage("score_cases", folders, arguments.workers)
        return
    folders.scores.mkdir(parents=True, exist_ok=True)
    beside: tuple[object, ...] = ("--keep-bags",) if arguments.keep_bags else ()
    if calibrating:
        beside += ("--thresholds", freeze.write_open(top))
    elif arguments.thresholds:
        beside += ("--thresholds", arguments.thresholds)
    for first in range(0, count, BATCH):
        make(arguments, folders, first, min(first + BATCH, count))
        stage("answer_cases", folders, arguments.workers, *beside)
        print(f"{len(done(folders.answers))} of {count} cases answered", flush=True)
    if calibrating:
        found = freeze.freeze(folders) if arguments.freeze else freeze.calibrated(folders)
        if arguments.gates:
            freeze.write_gates(arguments.gates, found)
        print("\n".join(freeze.lines(found)))
        return
    stage("score_cases", folders, arguments.workers)


def name_of_round(arguments: argparse.Namespace) -> str:
    """Answers with other thresholds than those of the package lie apart; of the scoring set, those
    of each freeze. `ConfigurationError` if that is not what was frozen.
    """
    if arguments.gates and arguments.which is not CaseSet.CALIBRATION:
        return "open"
    if arguments.thresholds:
        return str(arguments.thresholds.stem)
    return frozen.require_frozen()[:12] if arguments.which is CaseSet.SCORING else ""


def make(arguments: argparse.Namespace, folders: Folders, first: int, last: int) -> None:
    """The bags of the cases from `first` to before `last` that are not there."""
    quick = ("--quick",) if arguments.quick else ()
    stage(
        *("make_cases", folders, arguments.workers, "--set", arguments.which.value),
        *("--count", arguments.cases, "--from", first, "--to", last),
        *("--sets", arguments.sets, *quick),
    )


def stage(name: str, folders: Folders, workers: int, *arguments: object) -> None:
    """Run a stage as a process of its own; the benchmark ends with its status if it fails."""
    command: list[object] = [sys.executable, "-m", STAGES[name], "--workers", workers]
    command += ["--folder", folders.top, "--round", folders.round, *arguments]
    status = subprocess.run([str(word) for word in command]).returncode
    if status:
        raise SystemExit(status)


def main(argv: Sequence[str] | None = None) -> int:
    """Run the benchmark; exit status 1 if thresholds are not frozen or a stage fails."""
    parser = cli.command_line(prog="discrepancy", description=__doc__.splitlines()[0])
    add = parser.add_argument
    add("--set", type=CaseSet, choices=list(CaseSet), default=CaseSet.SCORING, dest="which")
    add("--cases", type=int, help=", ".join(f"{n} ({s.value})" for s, n in COUNTS.items()))
    add("--sets", type=int, default=2, help="of three recordings to train on, in each case")
    add("--quick", action="store_true", help="one short recording each: to try the machinery")
    add("--workers", type=int, default=os.cpu_count() or 1, help="processes")
    add("--out", type=Path, default=Path("runs/discrepancy_benchmark"), help="folder")
    add("--keep-bags", action="store_true", help="100 MB a case; to answer again")
    add("--bags-only", action="store_true", help="make the bags of all cases, and stop")
    add("--freeze", action="store_true", help="write the calibrated thresholds to the package")
    add("--gates", type=Path, help="file for thresholds that these clean cases calibrate")
    add("--thresholds", type=Path, help="answer with these (YAML; default: the packaged ones)")
    arguments = parser.parse_args(argv)
    if arguments.freeze and arguments.which is not CaseSet.CALIBRATION:
        parser.error("--freeze: the package is calibrated with --set calibration")
    if arguments.gates and arguments.which not in CLEAN:
        parser.error(f"--gates: calibrate with cases that hide nothing, --set {' or '.join(CLEAN)}")
    if arguments.cases is None:
        arguments.cases = COUNTS[arguments.which]
    return cli.run(lambda: run(arguments))


if __name__ == "__main__":
    sys.exit(main())
