"""Excitation trajectories by (35): coefficients of (32) that make the regressor well conditioned.

Minimised is log cond(Phi) + log cond(Phi with normalised columns) of the stacked regressor (29) of
a model over one period: the raw number is that of the report and depends on units, the normalised
one does not, and each alone leaves some parameters poorly determined. Constraints are position and
velocity limits of Table 2, the pump flow and the room of the boom tip; the stroke follows from the
positions. In the search tanh stands for sgn(q'), which makes the criterion jump whenever a sample
passes a reversal and so stops a search by gradients.
"""

import os
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from multiprocessing import get_context
from time import perf_counter
from typing import Annotated

import numpy as np
from pydantic import Field
from scipy.optimize import minimize

from crane_model.configuration import Schema, load, packaged
from crane_model.errors import ConfigurationError
from crane_model.machine import JOINTS, PLANAR_JOINTS, Machine
from crane_model.model_file import Model
from crane_trajectory.check import (
    Clearance,
    pump_flow,
    tip_room,
    trajectory_violations,
)
from crane_trajectory.fourier import FourierTrajectory, Samples, harmonic_basis
from crane_trajectory.merit import Experiment, condition_numbers, record_of

Share = Annotated[float, Field(ge=0, lt=1)]
Positive = Annotated[float, Field(gt=0)]
Count = Annotated[int, Field(ge=1)]
STEP = 1e-6  # of forward differences [rad, m]
DECIMALS = 6  # to which coefficients are rounded


class Search(Schema):
    """How the search samples, which margins it keeps, how it starts and ends."""

    samples: Count
    grid_per_harmonic: Annotated[int, Field(ge=4)]
    position_margin: Annotated[float, Field(ge=0, lt=0.5)]
    velocity_margin: Share
    flow_margin: Share
    room_margin: Annotated[float, Field(ge=0)]
    reversal_share: Positive
    start_amplitude: Annotated[float, Field(gt=0, le=1)]
    iterations: Count
    tolerance: Positive


class DesignSettings(Schema):
    """Everything of `data/design.yaml`."""

    search: Search
    experiment: Experiment
    plausible: dict[str, float]


def load_design_settings() -> DesignSettings:
    """The settings that ship with the package."""
    return load(packaged("crane_trajectory", "design.yaml"), DesignSettings)


@dataclass(frozen=True)
class Candidate:
    """What one start of the search led to."""

    trajectory: FourierTrajectory
    criterion: float  # log of the product of the two condition numbers, with sgn(q') as it is
    within_limits: bool
    seconds: float


class ExcitationProblem:
    """(35) for one model, period and number of harmonics.

    A point is the vector of `FourierTrajectory.coefficients` (2 N + 1, j), row by row. Functions of
    points take any number of them at once, (m, points), so that differences cost one call.
    """

    def __init__(
        self, model: Model, period: float, harmonics: int, search: Search, clearance: Clearance
    ) -> None:
        self.model = model
        self.machine = planar_machine(model)
        self.period = period
        self.harmonics = harmonics
        self.search = search
        self.clearance = clearance
        self.shape = (2 * harmonics + 1, len(model.joints))
        points = search.grid_per_harmonic * harmonics
        self._basis = self._over_a_period(search.samples)
        self._grid = self._over_a_period(points)
        limits = [self.machine.limits[joint] for joint in model.joints]
        # a trigonometric polynomial exceeds its largest sample by at most this factor
        between = 1.0 / np.cos(np.pi * harmonics / points)
        lowest, highest = np.array([(x.position_min, x.position_max) for x in limits]).T
        self._middle = (lowest + highest) / 2
        self._reach = (highest - lowest) * (0.5 - search.position_margin) / between
        slowest, fastest = np.array([(x.velocity_min, x.velocity_max) for x in limits]).T
        self._fastest = fastest * (1.0 - search.velocity_margin) / between
        self._slowest = slowest * (1.0 - search.velocity_margin) / between
        self._smooth = search.reversal_share * np.maximum(fastest, -slowest)
        self.matrix, self.bound = self._linear_limits()

    def minimise(self, rng: np.random.Generator, name: str) -> Candidate:
        """Local search by SLSQP from a random trajectory."""
        begin = perf_counter()
        result = minimize(
            lambda x: self.criterion(x[None])[0],
            self.random_point(rng),
            jac=lambda x: forward_difference(self.criterion, x),
            method="SLSQP",
            constraints=[
                {
                    "type": "ineq",
                    "fun": lambda x: self.bound - self.matrix @ x,
                    "jac": lambda _: -self.matrix,
                },
                {
                    "type": "ineq",
                    "fun": lambda x: self.reserves(x[None])[0],
                    "jac": lambda x: forward_difference(self.reserves, x),
                },
            ],
            options={"maxiter": self.search.iterations, "ftol": self.search.tolerance},
        )
        point = np.round(result.x, DECIMALS)
        trajectory = FourierTrajectory.from_coefficients(
            name, self.period, self.model.joints, point.reshape(self.shape)
        )
        found = trajectory_violations(self.machine, trajectory, self.clearance)
        return Candidate(
            trajectory,
            float(self.criterion(point[None], smooth=False)[0]),
            not found,
            perf_counter() - begin,
        )

    def criterion(self, points: np.ndarray, smooth: bool = True) -> np.ndarray:
        """(m, points) to (m,): log of raw times normalised condition number of Phi (29)."""
        coefficients = points.reshape(-1, *self.shape)
        samples = Samples(*(_stacked(basis @ coefficients) for basis in self._basis))
        direction = np.tanh(samples.velocity / self._smooth) if smooth else None
        regressor = self.model.regressor(record_of(self.model, samples, direction))
        phi = regressor.reshape(len(points), -1, regressor.shape[-1])
        raw, normalised = condition_numbers(phi.transpose(0, 2, 1) @ phi)
        return np.log(raw * normalised)

    def reserves(self, points: np.ndarray) -> np.ndarray:
        """(m, points) to (m, 3 grid): what is left of pump flow, of room to pillar and to ground.

        Shares of the pump flow and metres; negative where the limit less its margin is passed.
        """
        coefficients = points.reshape(-1, *self.shape)
        position = _stacked(self._grid.position @ coefficients)
        velocity = _stacked(self._grid.velocity @ coefficients)
        # SLSQP may look beyond Table 2, where a linkage may not exist
        position = np.clip(position, self._middle - self._reach, self._middle + self._reach)
        flow = pump_flow(self.machine, self.model.joints, position, velocity)
        allowed = self.machine.hydraulics.pump_flow * (1.0 - self.search.flow_margin)
        keep = np.array([self.clearance.pillar_clearance, self.clearance.lowest_tip])
        room = tip_room(self.machine, self.model.joints, position) - keep - self.search.room_margin
        return np.concatenate([1.0 - flow[:, None] / allowed, room], axis=1).reshape(
            len(points), -1
        )

    def random_point(self, rng: np.random.Generator) -> np.ndarray:
        """A random trajectory, scaled so that each joint uses a share of its limits."""
        k = np.arange(1, self.harmonics + 1)
        waves = rng.normal(size=self.shape) / np.concatenate([[1.0], k, k])[:, None]
        waves[0] = 0.0
        speed = self._grid.velocity @ waves
        used = [
            np.abs(self._grid.position @ waves).max(axis=0) / self._reach,
            speed.max(axis=0) / self._fastest,
            speed.min(axis=0) / self._slowest,
        ]
        waves *= self.search.start_amplitude / np.max(used, axis=0)
        waves[0] = self._middle + 0.2 * self._reach * rng.uniform(-1.0, 1.0, self.shape[1])
        return waves.ravel()

    def _linear_limits(self) -> tuple[np.ndarray, np.ndarray]:
        """A and b of A x <= b: positions and velocities on the grid within Table 2."""
        position, velocity = self._grid.position, self._grid.velocity
        side = np.vstack([position, -position, velocity, -velocity])
        matrix = np.kron(side, np.eye(self.shape[1]))  # a row a grid point and joint
        bounds = [
            self._middle + self._reach,
            self._reach - self._middle,
            self._fastest,
            -self._slowest,
        ]
        return matrix, np.concatenate([np.tile(bound, len(position)) for bound in bounds])

    def _over_a_period(self, points: int) -> Samples:
        time = np.arange(points) * self.period / points
        return harmonic_basis(time, self.period, self.harmonics)


def search(problem: ExcitationProblem, seed: int, starts: int, name: str) -> Iterator[Candidate]:
    """The outcome of every start, in order; a start depends on the seed and its number alone.

    Starts run on all cores, one process and one thread of linear algebra each: on matrices of this
    size more threads cost time, and their number would change the last digits.
    """
    workers = min(starts, os.cpu_count() or 1)
    rngs = [np.random.default_rng([seed, start]) for start in range(starts)]
    with (
        _environment(OMP_NUM_THREADS="1", OPENBLAS_NUM_THREADS="1"),
        ProcessPoolExecutor(workers, mp_context=get_context("spawn")) as pool,
    ):
        yield from pool.map(problem.minimise, rngs, [name] * starts)


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


def planar_machine(model: Model) -> Machine:
    """The machine of a model of the planar joints; `ConfigurationError` if it is another model."""
    if model.machine is None or not set(PLANAR_JOINTS) <= set(model.joints) <= set(JOINTS):
        raise ConfigurationError(
            f"model '{model.name}': a trajectory is found for a model with a machine and the "
            f"joints {', '.join(PLANAR_JOINTS)}, got the joints {', '.join(model.joints)}"
            + ("" if model.machine else " and no machine")
        )
    return model.machine


def forward_difference(
    function: Callable[[np.ndarray], np.ndarray], point: np.ndarray
) -> np.ndarray:
    """Gradient or Jacobian of a function of many points (m, v) -> (m, ...), at one point (v,)."""
    values = function(np.vstack([point, point + STEP * np.eye(len(point))]))
    return ((values[1:] - values[0]) / STEP).T


def _stacked(values: np.ndarray) -> np.ndarray:
    return values.reshape(-1, values.shape[-1])
