"""Measure how often `diagnose` finds the effect that was injected into a simulated crane.

One process makes bags of machines with injected effects. A second process answers from the bags
alone. A third process opens the ground truth and scores. An interrupted run continues with the
same code. Bags do not depend on thresholds, so they can be kept.
"""

import os
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from crane_benchmark.cases.case import Simulator
from crane_benchmark.cases.case_sets import CaseSet, cases
from crane_benchmark.folders import Folders, done
from crane_benchmark.scores import lock, locked
from crane_identification.data.arguments import request_of
from crane_model import cli

STAGES = {
    "make_cases": "crane_benchmark.cases.make_cases",
    "answer_cases": "crane_benchmark.answers.answer_cases",
    "score_cases": "crane_benchmark.scores.score_cases",
}
CASE_COUNTS = {
    CaseSet.TUNING: 40,
    CaseSet.CALIBRATION: 40,
    CaseSet.SCORING: 400,
    CaseSet.FORMER: 96,
    CaseSet.INDEPENDENT_TUNING: 60,
    CaseSet.INDEPENDENT_CLEAN: 40,
}
CLEAN = (CaseSet.CALIBRATION, CaseSet.INDEPENDENT_CLEAN)
CASES_PER_BATCH = 8  # cases whose bags are on the disk at once, 1 GB


@dataclass(frozen=True)
class Answering:
    """Which cases are answered (None: all), by which thresholds (None: those of the package)."""

    thresholds: Path | None
    names: tuple[str, ...] | None = None


@dataclass(frozen=True)
class BenchmarkRequest:
    """Request of the command; see its options."""

    which: CaseSet
    simulator: Simulator | None
    cases: int
    quick: bool
    workers: int
    out: Path
    keep_bags: bool
    lock: bool
    thresholds: Path | None


def run_batch(
    request: BenchmarkRequest, folders: Folders, answers: Sequence[Answering], first: int
) -> int:
    """Make the bags of the cases from `first` on that are not there, and answer; the status of the
    first stage that fails. Bags that are answered are deleted unless they are to be kept.
    """
    last = min(first + CASES_PER_BATCH, request.cases)
    making: list[object] = ["--set", request.which.value, "--count", request.cases]
    making += ["--from", first, "--to", last]
    if request.simulator is not None:
        making += ["--simulator", request.simulator.value]
    if request.quick:
        making.append("--quick")
    if status := stage("make_cases", folders, request.workers, *making):
        return status
    of_batch = [case.name for case in cases(request.which, request.cases)[first:last]]
    for answering in answers:
        names = of_batch
        if answering.names is not None:
            names = [name for name in of_batch if name in answering.names]
        how: list[object] = ["--only", *names]
        if request.keep_bags:
            how.append("--keep-bags")
        if answering.thresholds is not None:
            how += ["--thresholds", answering.thresholds]
        if status := stage("answer_cases", folders, request.workers, *how):
            return status
    return 0


def stage(name: str, folders: Folders, workers: int, *arguments: object) -> int:
    """The status with which a stage ends."""
    command: list[object] = [sys.executable, "-m", STAGES[name], "--workers", workers]
    command += ["--folder", folders.top, "--round", folders.round, *arguments]
    return subprocess.run([str(word) for word in command]).returncode


def run(request: BenchmarkRequest) -> None:
    """Run all stages, batch by batch; raises `CraneError`."""
    which = request.which
    top = request.out.resolve() / which.value
    calibrating = which is CaseSet.CALIBRATION or request.lock
    folders = Folders(top, name_of_round(request))
    if which is CaseSet.SCORING and len(done(folders.rows)) >= request.cases:
        print(f"scored already with these thresholds, which is done once: {folders.results}")
        score(folders, request.workers)
        return
    folders.scores.mkdir(parents=True, exist_ok=True)
    answers: tuple[Answering, ...]
    if calibrating:
        answers = (Answering(lock.write_open(top)),)
    elif which is CaseSet.SCORING and not request.thresholds:
        answers = crossed(request, top)
    else:
        answers = (Answering(request.thresholds),)
    for first in range(0, request.cases, CASES_PER_BATCH):
        if status := run_batch(request, folders, answers, first):
            raise SystemExit(status)
        print(f"{len(done(folders.answers))} of {request.cases} cases answered", flush=True)
    if calibrating:
        found = lock.lock(folders, which) if request.lock else lock.calibrated(folders)
        print("\n".join(lock.lines(found)))
        return
    score(folders, request.workers)


def name_of_round(request: BenchmarkRequest) -> str:
    """Answers with other thresholds than those of the package lie apart; of the scoring set, those
    of each lock. `ConfigurationError` if that is not what was locked.
    """
    if request.which is CaseSet.INDEPENDENT_CLEAN and request.lock:
        return "open"
    if request.thresholds:
        return request.thresholds.stem
    return locked.require_locked()[:12] if request.which is CaseSet.SCORING else ""


def crossed(request: BenchmarkRequest, top: Path) -> tuple[Answering, ...]:
    """Each simulator's cases by the thresholds that were calibrated on the other.

    `ConfigurationError` if cases of the primary simulator are asked for and no thresholds were
    calibrated on the independent one.
    """
    every = cases(CaseSet.SCORING, request.cases)
    names_of_simulator = {
        simulator: tuple(case.name for case in every if case.simulator is simulator)
        for simulator in Simulator
    }
    answers = []
    if request.simulator in (None, Simulator.INDEPENDENT):
        answers.append(Answering(None, names_of_simulator[Simulator.INDEPENDENT]))
    if request.simulator in (None, Simulator.PRIMARY):
        top.mkdir(parents=True, exist_ok=True)
        answers.append(
            Answering(lock.write_independent(top), names_of_simulator[Simulator.PRIMARY])
        )
    return tuple(answers)


def score(folders: Folders, workers: int) -> None:
    """Score what is answered, and print it."""
    if status := stage("score_cases", folders, workers):
        raise SystemExit(status)


def main(argv: Sequence[str] | None = None) -> int:
    """Run the benchmark; exit status 1 if thresholds are not locked or a stage fails."""
    parser = cli.command_line(prog="discrepancy", description=__doc__.splitlines()[0])
    add = parser.add_argument
    add("--set", type=CaseSet, choices=list(CaseSet), default=CaseSet.SCORING, dest="which")
    add(
        "--simulator",
        type=Simulator,
        choices=list(Simulator),
        help="simulator of the cases (default: both)",
    )
    add("--cases", type=int, help=", ".join(f"{n} ({s.value})" for s, n in CASE_COUNTS.items()))
    add(
        "--quick",
        action="store_true",
        help="one short recording for each case, to test the benchmark itself",
    )
    add("--workers", type=int, default=os.cpu_count() or 1, help="number of processes")
    add(
        "--out",
        type=Path,
        default=Path("runs/discrepancy_benchmark"),
        help="folder for bags, answers and results",
    )
    add("--keep-bags", action="store_true", help="keep the bags (100 MB per case), to answer again")
    add("--lock", action="store_true", help="write the calibrated thresholds to the package")
    add(
        "--thresholds",
        type=Path,
        help="thresholds to answer with (YAML; default: the packaged file)",
    )
    arguments = parser.parse_args(argv)
    if arguments.lock and arguments.which not in CLEAN:
        parser.error(f"--lock: calibrate with --set {' or '.join(CLEAN)}")
    if arguments.cases is None:
        arguments.cases = CASE_COUNTS[arguments.which]
    return cli.run(lambda: run(request_of(BenchmarkRequest, arguments)))


if __name__ == "__main__":
    sys.exit(main())
