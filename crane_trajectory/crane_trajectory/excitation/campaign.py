"""A campaign: trajectories designed in sequence, each for the information that is still lacking."""

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor
from dataclasses import replace

from crane_model.errors import RangeError
from crane_trajectory.excitation.merit import one_period
from crane_trajectory.excitation.problem import ExcitationProblem, FoundTrajectory
from crane_trajectory.excitation.search import search
from crane_trajectory.motion.fourier import FourierTrajectory


def campaign(
    problem: ExcitationProblem,
    names: Sequence[str],
    seed: int,
    starts: int,
    workers: Executor,
    progress: Callable[[], object] = lambda: None,
) -> Iterator[FoundTrajectory]:
    """One trajectory a name, each minimising the criterion of all data up to and with its own.

    Raises `RangeError` if no start leads to a trajectory within the limits.
    """
    for number, name in enumerate(names):
        found = search(problem, seed + number, starts, name, workers, progress)
        best = found[0]
        if best.violations:
            listed = "\n  ".join(map(str, best.violations))
            raise RangeError(
                f"period {problem.period:g} s, {problem.harmonics} harmonics: none of {starts} "
                "starts led to a trajectory within the limits; lengthen the period, or try more "
                f"--starts or another --seed; the best passes:\n  {listed}"
            )
        yield best
        problem = after(problem, best.trajectory)


def after(problem: ExcitationProblem, trajectory: FourierTrajectory) -> ExcitationProblem:
    """The problem of the next trajectory, once this one has been recorded for a period."""
    regressor = one_period(problem.model, trajectory, problem.search.samples)
    return replace(problem, criterion=problem.criterion.after(regressor))
