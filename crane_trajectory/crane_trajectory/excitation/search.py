"""The search for excitation trajectories by (35): one local search, many starts, campaigns."""

import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor, ProcessPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import cached_property
from multiprocessing import get_context

import numpy as np

from crane_model.errors import ConfigurationError, RangeError
from crane_model.machine import Machine
from crane_model.model_file import Model
from crane_trajectory.excitation.criterion import Criterion, one_period, record_of
from crane_trajectory.excitation.limits import (
    Limit,
    Limits,
    Margins,
    SearchSettings,
    SearchStage,
    pull_back,
    smooth_record,
    smooth_regressor,
)
from crane_trajectory.motion.check import (
    Clearance,
    Violation,
    maxima,
    trajectory_grid,
    trajectory_violations,
)
from crane_trajectory.motion.periodic import FourierTrajectory, MotionSamples, harmonic_basis

DECIMALS = 6  # to which coefficients are rounded
REDUCTIONS = (0.0, *(1e-4 * 2.0 ** np.arange(13)))  # of amplitude, tried in turn
QUANTITIES = {
    "velocity": Limit.VELOCITY,
    "pump flow": Limit.FLOW,
    "height": Limit.CLEARANCE,
    "distance from pillar": Limit.CLEARANCE,
}


@dataclass(frozen=True)
class FoundTrajectory:
    """A trajectory that a local search led to."""

    trajectory: FourierTrajectory
    criterion: float  # with sgn(q') as it is
    violations: tuple[Violation, ...]


@dataclass(frozen=True)
class ExcitationProblem:
    """Minimise a criterion over the coefficients of (32) within limits.

    A point is the vector of `FourierTrajectory.coefficients` (2 N + 1, j), row by row.
    `acceleration` bounds joints [rad/s2, m/s2]; `without` names limits that do not count.
    """

    model: Model
    criterion: Criterion
    period: float
    harmonics: int
    search: SearchSettings
    margins: Margins
    clearance: Clearance
    acceleration: dict[str, float] = field(default_factory=dict)
    without: frozenset[Limit] = frozenset()

    @property
    def shape(self) -> tuple[int, int]:
        return 2 * self.harmonics + 1, len(self.model.joints)

    @cached_property
    def machine(self) -> Machine:
        return machine_of(self.model)

    @cached_property
    def start_limits(self) -> Limits:
        return self.limits(self.search.explore.grid_per_harmonic)

    def limits(self, per_harmonic: int) -> Limits:
        """On a grid of so many points per period of the highest harmonic."""
        return Limits(
            self.machine,
            self.model.joints,
            self._over_a_period(per_harmonic * self.harmonics),
            self.margins,
            self.clearance,
            np.array([self.acceleration.get(joint, np.inf) for joint in self.model.joints]),
            self.without,
        )

    def value(self, point: np.ndarray) -> float:
        """The criterion as it is published: sgn(q') and the true extreme eigenvalues."""
        regressor = self.model.regressor(record_of(self.model, self._motion(point)))
        return self.criterion.exact(self.criterion.gram(regressor))

    def smooth(self, point: np.ndarray, stage: SearchStage) -> tuple[float, np.ndarray]:
        """The criterion as smoothed in a stage, and its gradient (v,)."""
        width = stage.reversal_share * self.machine.ranges(self.model.joints).top_speed
        record = smooth_record(self.model, self._motion(point), width)
        regressor = smooth_regressor(self.model, record)
        value, slope = self.criterion.evaluate(self.criterion.gram(regressor), stage.power)
        weight = 2.0 * self.criterion.row_weight[:, None] * (regressor @ slope)
        slopes = pull_back(self.model, record, weight, width)
        parts = [functions.T @ part for functions, part in zip(self._basis, slopes, strict=True)]
        return value, np.sum(parts, axis=0).ravel()

    def descend(self, point: np.ndarray, stage: SearchStage) -> np.ndarray:
        """The point to which SLSQP gets from the given one."""
        from scipy.optimize import minimize  # half a second to import

        limits = self.limits(stage.grid_per_harmonic)
        constraints = [
            {
                "type": "ineq",
                "fun": lambda x: limits.bound - limits.matrix @ x,
                "jac": lambda _: -limits.matrix,
            }
        ]
        if not {Limit.FLOW, Limit.CLEARANCE} <= self.without:
            constraints.append(
                {"type": "ineq", "fun": limits.reserves, "jac": limits.reserve_slopes}
            )
        return minimize(
            self.smooth,
            point,
            args=(stage,),
            jac=True,
            method="SLSQP",
            constraints=constraints,
            options={"maxiter": stage.iterations, "ftol": stage.tolerance},
        ).x

    def explore(self, rng: np.random.Generator) -> np.ndarray:
        """The point that the first stage leads to from a random trajectory."""
        start = self.random_point(rng)
        found = self.start_limits.repaired(self.descend(start, self.search.explore))
        return min(found, start, key=self.value)

    def polish(self, point: np.ndarray, name: str) -> FoundTrajectory:
        """The trajectory that the second stage leads to, within the limits at all times."""
        limits = self.limits(self.search.polish.grid_per_harmonic)
        found = limits.repaired(self.descend(point, self.search.polish))
        candidates = [self.fitted(candidate, name) for candidate in (found, point)]
        return min(candidates, key=lambda found: (bool(found.violations), found.criterion))

    def fitted(self, point: np.ndarray, name: str) -> FoundTrajectory:
        """The trajectory of a point, scaled down where extremes between grid points need it."""
        for reduction in REDUCTIONS:
            scaled = np.round(self.start_limits.drawn_home(point, 1.0 - reduction), DECIMALS)
            trajectory = FourierTrajectory.from_coefficients(
                name, self.period, self.model.joints, scaled.reshape(self.shape)
            )
            violations = self.check(trajectory)
            if not violations:
                break
        return FoundTrajectory(trajectory, self.value(scaled), violations)

    def random_point(self, rng: np.random.Generator) -> np.ndarray:
        limits = self.start_limits
        k = np.arange(1, self.harmonics + 1)
        waves = rng.normal(size=self.shape) / np.concatenate([[1.0], k, k])[:, None]
        waves[0] = 0.0
        half = (limits.highest - limits.lowest) / 2
        swing = np.abs(limits.basis.position @ waves).max(axis=0)
        waves *= self.search.start_amplitude * half / swing
        waves[0] = limits.lowest + half * (1.0 + 0.4 * rng.uniform(-1.0, 1.0, self.shape[1]))
        return limits.repaired(waves.ravel())

    def check(self, trajectory: FourierTrajectory) -> tuple[Violation, ...]:
        """The limits that count and that the trajectory passes at any time, margins aside."""
        found = trajectory_violations(self.machine, trajectory, self.clearance)
        kept = [v for v in found if QUANTITIES.get(v.quantity) not in self.without]
        times, peaks = maxima(
            lambda time: np.abs(trajectory.evaluate(time).acceleration), trajectory_grid(trajectory)
        )
        for joint, time, peak in zip(self.model.joints, times, peaks, strict=True):
            bound, unit = self.acceleration.get(joint, np.inf), f"{self.machine.units[joint]}/s2"
            if peak > bound:
                kept.append(Violation(joint, "acceleration", time, bound, peak, unit))
        return tuple(kept)

    def _motion(self, point: np.ndarray) -> MotionSamples:
        coefficients = point.reshape(self.shape)
        return MotionSamples(*(functions @ coefficients for functions in self._basis))

    @cached_property
    def _basis(self) -> MotionSamples:
        return self._over_a_period(self.search.samples)

    def _over_a_period(self, points: int) -> MotionSamples:
        time = np.arange(points) * self.period / points
        return harmonic_basis(time, self.period, self.harmonics)


def machine_of(model: Model) -> Machine:
    """The machine of a model; `ConfigurationError` if it has none."""
    if model.machine is None:
        raise ConfigurationError(
            f"model '{model.name}': a trajectory is found for a model with a machine, got the "
            f"joints {', '.join(model.joints)} and no machine; add the key 'machine' to its file"
        )
    return model.machine


def search(
    problem: ExcitationProblem,
    seed: int,
    starts: int,
    name: str,
    workers: Executor,
    progress: Callable[[], object] = lambda: None,
) -> list[FoundTrajectory]:
    """The trajectories of the best starts, best first; those that pass a limit come last.

    Every start explores, in processes; the best few are polished. A start depends on the seed and
    its number alone, so the outcome does not depend on the number of workers.
    `progress` is called `steps(problem, starts)` times.
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


def campaign(
    problem: ExcitationProblem,
    names: Sequence[str],
    seed: int,
    starts: int,
    workers: Executor,
    progress: Callable[[], object] = lambda: None,
) -> Iterator[FoundTrajectory]:
    """One trajectory a name, designed in sequence, each for the information that is still lacking:
    it minimises the criterion of all data up to and with its own.

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
