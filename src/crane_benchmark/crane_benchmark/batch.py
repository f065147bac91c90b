"""A few cases through the stages of the benchmark, each of which is a process of its own."""

import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

from crane_benchmark.cases.case import Site
from crane_benchmark.cases.case_sets import CaseSet, cases
from crane_benchmark.folders import Folders

STAGES = {
    "make_cases": "crane_benchmark.cases.make_cases",
    "answer_cases": "crane_benchmark.answers.answer_cases",
    "score_cases": "crane_benchmark.scores.score_cases",
}


@dataclass(frozen=True)
class Answering:
    """Which cases are answered (None: all), by which thresholds (None: those of the package)."""

    thresholds: Path | None
    names: tuple[str, ...] | None = None


@dataclass(frozen=True)
class Batch:
    """The cases from `first` to before `last` of a set of `count`; only those of a `site`, if one
    is given. Bags that are answered are deleted unless they are to be kept.
    """

    which: CaseSet
    count: int
    first: int
    last: int
    site: Site | None
    sets: int
    quick: bool
    folders: Folders
    workers: int
    keep: bool
    answers: tuple[Answering, ...]


def run_batch(batch: Batch) -> int:
    """Make the bags that are not there, and answer; the status of the first stage that fails."""
    making: list[object] = ["--set", batch.which.value, "--count", batch.count]
    making += ["--from", batch.first, "--to", batch.last, "--sets", batch.sets]
    if batch.site is not None:
        making += ["--site", batch.site.value]
    if batch.quick:
        making.append("--quick")
    if status := stage("make_cases", batch.folders, batch.workers, *making):
        return status
    own = [case.name for case in cases(batch.which, batch.count)[batch.first : batch.last]]
    for one in batch.answers:
        names = own if one.names is None else [name for name in own if name in one.names]
        how: list[object] = ["--only", *names]  # beside it other workers make and answer theirs
        if batch.keep:
            how.append("--keep-bags")
        if one.thresholds is not None:
            how += ["--thresholds", one.thresholds]
        if status := stage("answer_cases", batch.folders, batch.workers, *how):
            return status
    return 0


def stage(name: str, folders: Folders, workers: int, *arguments: object) -> int:
    """The status with which a stage ends."""
    command: list[object] = [sys.executable, "-m", STAGES[name], "--workers", workers]
    command += ["--folder", folders.top, "--round", folders.round, *arguments]
    return subprocess.run([str(word) for word in command]).returncode
