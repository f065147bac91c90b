"""What a case of the discrepancy benchmark takes: its eight bags, and one diagnosis of them."""

import os
import resource
import subprocess
import sys
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from threadpoolctl import threadpool_limits

pytest.importorskip("mujoco")

from crane_benchmark import CaseKind, Folders
from crane_benchmark.answers.answer_cases import given
from crane_benchmark.cases.case import Simulator
from crane_benchmark.cases.case_sets import CaseSet, cases
from crane_benchmark.cases.make_cases import make_case
from crane_identification import Options
from crane_identification.diagnosis.diagnosis import diagnose
from crane_identification.thresholds import load_thresholds

SETS = {Simulator.PRIMARY: CaseSet.TUNING, Simulator.INDEPENDENT: CaseSet.INDEPENDENT_TUNING}
KINDS = (CaseKind.SINGLE, CaseKind.PAIR, CaseKind.NOTHING)  # the first case of each
TO_MAKE, TO_ANSWER = 10.0, 10.0  # s of processor time


def taken(what: Callable[[], object]) -> tuple[float, float]:
    """Processor time, that of its processes included, and wall time [s]."""
    start = sum(os.times()[:4]), time.perf_counter()
    what()
    return sum(os.times()[:4]) - start[0], time.perf_counter() - start[1]


def started(module: str) -> float:
    """Processor time [s] of a process that does no more than to import a module."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run([sys.executable, "-c", f"import {module}"], check=True)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def test_the_start_of_a_process(measured) -> None:
    makes, answers = "crane_benchmark.cases.make_cases", "crane_benchmark.answers.answer_cases"
    for module in (makes, answers):
        started(module)  # from the disk
    measured(
        "start of a process that makes, and of one that answers several cases, processor time",
        "",
        "{making:.1f} s, {answering:.1f} s",
        making=started(makes),
        answering=started(answers),
    )


@pytest.mark.parametrize("simulator", Simulator)
@threadpool_limits.wrap(1)  # one process a core, as in the benchmark
def test_a_case(tmp_path: Path, measured, simulator: Simulator) -> None:
    every = cases(SETS[simulator], 40)
    chosen = [next(one for one in every if one.kind is kind) for kind in KINDS]
    make_case(Folders(tmp_path / "first"), chosen[0])  # compiles what there is
    folders = Folders(tmp_path / "set")
    making = [taken(partial(make_case, folders, one)) for one in chosen]
    cpu, wall = np.mean(making, axis=0)
    measured(
        f"eight bags of a case, {simulator.value}, processor time, mean of {len(chosen)}",
        f"at most {TO_MAKE:g} s",
        "{cpu:.1f} s, at most {most:.1f} s ({wall:.1f} s by the clock)",
        cpu=cpu,
        most=np.max(making, axis=0)[0],
        wall=wall,
    )
    recordings = [given(folders.bags / one.name) for one in chosen]
    thresholds = load_thresholds()
    diagnose(*recordings[0], Options(), thresholds)
    answering = [taken(partial(diagnose, *one, Options(), thresholds)) for one in recordings]
    answered, later = np.mean(answering, axis=0)
    measured(
        f"one diagnosis of them, {simulator.value}, processor time, mean of {len(chosen)}",
        f"at most {TO_ANSWER:g} s",
        "{answered:.1f} s, at most {most:.1f} s ({later:.1f} s by the clock)",
        answered=answered,
        most=np.max(answering, axis=0)[0],
        later=later,
    )
    assert cpu < TO_MAKE
    assert answered < TO_ANSWER
