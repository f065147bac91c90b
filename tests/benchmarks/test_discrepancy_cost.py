"""What a case of the discrepancy benchmark takes: its eight bags, and one diagnosis of them."""

import time
from collections.abc import Callable
from pathlib import Path

import pytest
from threadpoolctl import threadpool_limits

pytest.importorskip("mujoco")

from crane_benchmark.answers.given import given
from crane_benchmark.cases.case import Case, CaseKind, Site
from crane_benchmark.cases.case_sets import CaseSet, cases
from crane_benchmark.cases.make_cases import MakingJob, make_case
from crane_benchmark.folders import Folders
from crane_identification.diagnosis.diagnosis import diagnose
from crane_identification.options import Options
from crane_identification.thresholds import load_thresholds

SETS = {Site.HOME: CaseSet.TUNING, Site.AWAY: CaseSet.AWAY_TUNING}
TO_MAKE, TO_ANSWER = 10.0, 10.0  # s of processor time


def taken(what: Callable[[], object]) -> tuple[float, float]:
    """Processor and wall time [s], the second time: nothing is compiled any more."""
    what()
    start = time.process_time(), time.perf_counter()
    what()
    return time.process_time() - start[0], time.perf_counter() - start[1]


@pytest.mark.parametrize("site", Site)
def test_a_case(tmp_path: Path, measured, site: Site) -> None:
    case: Case = next(one for one in cases(SETS[site], 40) if one.kind is CaseKind.SINGLE)
    folders = Folders(tmp_path)
    cpu, wall = taken(lambda: make_case(MakingJob(case, folders, 2)))
    measured(
        f"eight bags of a case that hides one effect, {site.value}, processor time",
        f"at most {TO_MAKE:g} s",
        "{cpu:.1f} s ({wall:.1f} s by the clock)",
        cpu=cpu,
        wall=wall,
    )
    recordings = given(folders.bags / case.name)
    thresholds = load_thresholds()
    with threadpool_limits(1):  # one process a core, as in the benchmark
        answered, later = taken(lambda: diagnose(*recordings, Options(), thresholds))
    measured(
        f"one diagnosis of them, {site.value}, processor time",
        f"at most {TO_ANSWER:g} s",
        "{answered:.1f} s ({later:.1f} s by the clock)",
        answered=answered,
        later=later,
    )
    assert cpu < TO_MAKE
    assert answered < TO_ANSWER
