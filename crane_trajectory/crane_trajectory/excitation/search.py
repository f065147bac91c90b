"""Multi-start over processes: every start explores, the best few are polished."""

import os
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, ProcessPoolExecutor
from contextlib import contextmanager
from multiprocessing import get_context

import numpy as np

from crane_trajectory.excitation.problem import ExcitationProblem, FoundTrajectory


def search(
    problem: ExcitationProblem,
    seed: int,
    starts: int,
    name: str,
    workers: Executor,
    progress: Callable[[], object] = lambda: None,
) -> list[FoundTrajectory]:
    """The trajectories of the best starts, best first; those that pass a limit come last.

    A start depends on the seed and its number alone, so the outcome does not depend on the number
    of workers. `progress` is called `steps(problem, starts)` times.
    """
    rngs = [np.random.default_rng([seed, start]) for start in range(starts)]
    points = []
    for point in workers.map(problem.explore, rngs):
        points.append(point)
        progress()
    points.sort(key=problem.value)
    candidates = []
    for candidate in workers.map(
        problem.polish, points[: problem.search.survivors], [name] * starts
    ):
        candidates.append(candidate)
        progress()
    return sorted(candidates, key=lambda found: (bool(found.violations), found.criterion))


def steps(problem: ExcitationProblem, starts: int) -> int:
    """How often a search calls `progress`."""
    return starts + min(starts, problem.search.survivors)


@contextmanager
def workers(most: int) -> Iterator[Executor]:
    """Processes on all cores, `most` at the most, with one thread of linear algebra each.

    On matrices of this size more threads cost time, and their number would change the last digits.
    """
    count = min(most, os.cpu_count() or 1)
    with (
        _environment(OMP_NUM_THREADS="1", OPENBLAS_NUM_THREADS="1"),
        ProcessPoolExecutor(count, mp_context=get_context("spawn")) as pool,
    ):
        yield pool


@contextmanager
def _environment(**variables: str) -> Iterator[None]:
    """Environment variables for the processes started inside the block."""
    before = {name: os.environ.get(name) for name in variables}
    os.environ.update(variables)
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value
