"""The recording that a motion would give, and how clearly it discriminates hypotheses."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from crane_model.cylinders import lever_arm
from crane_model.errors import ConfigurationError
from crane_model.machine import Machine
from crane_model.model_file import Model
from crane_model.record import Record
from crane_model.result_file import OpenMember
from crane_model.terms import Term, term_from_mapping
from crane_model.terms.gravity_and_load import Payload
from crane_model.terms.term import Load
from crane_trajectory.motion.periodic import FourierTrajectory, MotionSamples, SweepTrajectory

SAMPLES_A_ROW = 10  # of the motion, whose mean is a row
UNSURE_TIME = 0.1  # s around a reversal in which no row is used
STANDING = 0.01  # share of the largest speed of a motion, below which the sign is not known
USED_SHARE = 0.5  # of the samples of a row, that must be used
SHAPE_STEP = 0.02  # relative, of the difference with respect to a nonlinear parameter
ROUNDING = 1e-9  # of the largest column: what is left of one below is rounding
FORCE_ROUNDS = 2  # in which the force converges that terms of a model take from the force


def steady_pressures(
    machine: Machine,
    joint: str,
    position: np.ndarray,
    velocity: np.ndarray,
    force: np.ndarray,
    raised: float = 0.0,
) -> tuple[np.ndarray, np.ndarray]:
    """p_A and p_B (n,) [Pa] at positions and velocities (n,) and a generalized force (n,), of a
    cylinder that a valve with four equal edges moves steadily.

    Both edges pass what the piston sweeps: with areas A, p_S and p_T of supply and tank, F of (19),

    (p_S - p_A)/A_A^2 = (p_B - p_T)/A_B^2 = y, F = A_A p_S - A_B p_T - y (A_A^3 + A_B^3), extending
    (p_A - p_T)/A_A^2 = (p_S - p_B)/A_B^2 = y, F = A_A p_T - A_B p_S + y (A_A^3 + A_B^3), else

    `raised` [Pa] is added to the pressure of the tank: back-pressure.
    """
    cylinder, supply = machine.cylinders[joint], machine.hydraulics
    a, b = cylinder.area_a, cylinder.area_b
    high, low = supply.supply_pressure, supply.tank_pressure + raised
    arm = lever_arm(machine, joint, position)
    piston_force = force / arm
    extending = arm * velocity > 0.0
    cubes = a**3 + b**3
    y = (
        np.where(extending, a * high - b * low - piston_force, piston_force - a * low + b * high)
        / cubes
    )
    pressure_a = np.where(extending, high - a**2 * y, low + a**2 * y)
    pressure_b = np.where(extending, low + b**2 * y, high - b**2 * y)
    return pressure_a, pressure_b


@dataclass(frozen=True)
class Hypothesis:
    """An effect with its size: a term and the values (k,) of its parameters."""

    term: Term
    values: np.ndarray

    @classmethod
    def of(cls, member: OpenMember) -> "Hypothesis":
        """Hypothesis of a question's member; `ConfigurationError` if there is no such term."""
        try:
            return cls(term_from_mapping(member.term), np.array(member.values))
        except ValueError as error:
            raise ConfigurationError(
                f"{member.name} ({member.joint}): {error}; name its file by --terms, as for "
                "diagnose"
            ) from None

    def same_effect(self, hypothesis: "Hypothesis") -> bool:
        """Return whether both are model forms of the same effect, on the same joint."""
        together = _kinds(self.term) & _kinds(hypothesis.term)
        return bool(together) and self.term.only_joint == hypothesis.term.only_joint

    def bent(self) -> list[tuple[Term, Term, float]]:
        """Terms to either side of each nonlinear parameter's value, and their distance."""
        out = []
        for field in self.term.shapes:
            middle = float(getattr(self.term, field))
            ends = [
                self.term.model_validate({**self.term.model_dump(), field: middle * (1.0 + s)})
                for s in (-SHAPE_STEP, SHAPE_STEP)
            ]
            out.append((ends[0], ends[1], 2.0 * SHAPE_STEP))
        return out


def _kinds(term: Term) -> set[str]:
    """Types of the usual law of its effect, and of others of it."""
    if term.effect is None:
        return set(term.draws)
    return {term.effect.law_of or term.type, *term.effect.kin, *term.draws}


@dataclass(frozen=True)
class PlannedRecording:
    """Whole `periods` of a trajectory, with a mass at the tip [kg] and a raised tank [Pa]."""

    trajectory: FourierTrajectory | SweepTrajectory
    periods: int
    load: float = 0.0
    back_pressure: float = 0.0

    @property
    def duration(self) -> float:
        return self.periods * self.trajectory.period

    def record(self, model: Model, row_rate: float, run: int) -> Record:
        """Its samples, without forces; `run` is its number."""
        rate = row_rate * SAMPLES_A_ROW
        time = np.arange(int(self.duration * rate)) / rate
        motion = self.trajectory.evaluate(time)
        columns = [self.trajectory.joint_names.index(joint) for joint in model.joints]
        motion = MotionSamples(*(np.ascontiguousarray(samples[:, columns]) for samples in motion))
        slow = STANDING * np.abs(motion.velocity).max(axis=0)
        return Record(
            joints=model.joints,
            time=time,
            position=motion.position,
            velocity=motion.velocity,
            acceleration=motion.acceleration,
            run=np.full(len(time), run),
            velocity_resolution=slow,
        )


def with_forces(model: Model, record: Record, force: np.ndarray, raised: float) -> Record:
    """The record with a force (n, j), and the chamber pressures that it takes."""
    machine = model.machine
    assert machine is not None  # a trajectory is designed for a model with one
    record = replace(record, force=force)
    if not set(model.joints) <= set(machine.cylinders):
        return record
    pairs = [
        steady_pressures(
            machine, joint, record.position[:, j], record.velocity[:, j], force[:, j], raised
        )
        for j, joint in enumerate(model.joints)
    ]
    pressure_a, pressure_b = (np.stack(side, axis=1) for side in zip(*pairs, strict=True))
    return replace(record, pressure_a=pressure_a, pressure_b=pressure_b)


def used_samples(record: Record, rate: float) -> np.ndarray:
    """(n, j): 1.0 where the sign of a velocity is known."""
    still = record.direction == 0.0
    turned = np.zeros_like(still)
    turned[1:] = record.direction[1:] * record.direction[:-1] < 0.0
    near = np.ones(2 * int(np.ceil(UNSURE_TIME * rate)) + 1)
    wrong = np.stack(
        [np.convolve(column, near, mode="same") for column in (still | turned).T.astype(float)],
        axis=1,
    )
    return (wrong < USED_SHARE).astype(float)


def in_rows(values: np.ndarray) -> np.ndarray:
    """Means (rows, ...) of `SAMPLES_A_ROW` samples (n, ...) each."""
    whole = len(values) // SAMPLES_A_ROW * SAMPLES_A_ROW
    shape = (-1, SAMPLES_A_ROW, *values.shape[1:])
    means: np.ndarray = values[:whole].reshape(shape).mean(axis=1)
    return means


class PlannedExperiment:
    """Recordings, beside a model whose values are known, with noise of the force (j,) a row: how
    clearly they discriminate hypotheses, by T-optimality (Atkinson and Fedorov 1975).

    Of two hypotheses, one is true, and the other is fitted to what it does: with all parameters of
    the model, its own, and its nonlinear parameters linearised. What that cannot follow, over the
    noise, is their separation: the square root of the 2 dlogL to be expected between them. The
    other way round it is another one; the smaller counts.

    Raises `DataError` where a term needs what a prediction does not have.
    """

    def __init__(
        self,
        model: Model,
        recordings: Sequence[PlannedRecording],
        noise: np.ndarray,
        row_rate: float,
    ):
        self._model, self._recordings = model, recordings
        self._records = [
            planned.record(model, row_rate, run) for run, planned in enumerate(recordings, start=1)
        ]
        self._samples = [used_samples(record, row_rate * SAMPLES_A_ROW) for record in self._records]
        self._used = np.concatenate([in_rows(used) > USED_SHARE for used in self._samples])
        self._weight = 1.0 / noise
        self._seen: dict[Term, np.ndarray] = {}

    @cached_property
    def _known(self) -> list[Record]:
        out = []
        for run, (record, planned) in enumerate(
            zip(self._records, self._recordings, strict=True), 1
        ):
            force = hung = np.zeros_like(record.position)
            if planned.load:
                hung = planned.load * _tip((run,)).columns(record, self._model.setting)[:, :, 0]
            for _ in range(FORCE_ROUNDS):
                known = with_forces(self._model, record, force, planned.back_pressure)
                force = self._model.predict(known) + hung
            out.append(with_forces(self._model, record, force, planned.back_pressure))
        return out

    @cached_property
    def _basis(self) -> np.ndarray:
        """Orthonormal directions (N, d) of what the model takes up, and the known loads."""
        parts = [self._model.regressor(record) for record in self._known]
        loaded = [run for run, planned in enumerate(self._recordings, 1) if planned.load]
        columns = self._rows(parts)
        if loaded:
            tip = _tip(loaded)
            weight = [tip.columns(record, self._model.setting) for record in self._known]
            columns = np.concatenate([columns, self._rows(weight)], axis=1)
        return _directions(columns)

    def beside(self, term: Term) -> np.ndarray:
        """Columns (N, k) of a term over the noise, beside what the model takes up."""
        if term not in self._seen:
            columns = self._rows(
                [term.columns(record, self._model.setting) for record in self._known]
            )
            self._seen[term] = columns - self._basis @ (self._basis.T @ columns)
        return self._seen[term]

    def shown(self, hypothesis: Hypothesis) -> float:
        return float(np.linalg.norm(self.beside(hypothesis.term) @ hypothesis.values))

    def separation(self, first: Hypothesis, second: Hypothesis) -> float:
        """Separation of two hypotheses, whichever is true."""
        return min(self._left(first, second), self._left(second, first))

    def _left(self, true: Hypothesis, fitted: Hypothesis) -> float:
        """Residual of the first that the second cannot follow."""
        force = self.beside(true.term) @ true.values
        slopes = [
            (self.beside(after) - self.beside(before)) @ fitted.values / apart
            for before, after, apart in fitted.bent()
        ]
        from scipy.optimize import nnls  # half a second to import

        columns = self.beside(fitted.term)
        positive = np.array(
            [parameter.minimum == 0.0 for parameter in fitted.term.parameters(self._model.setting)]
        )
        free = _directions(np.column_stack([columns[:, ~positive], *slopes]))
        bound, left = (
            values - free @ (free.T @ values) for values in (columns[:, positive], force)
        )
        return float(nnls(bound, left)[1]) if positive.any() else float(np.linalg.norm(left))

    def _rows(self, parts: Sequence[np.ndarray]) -> np.ndarray:
        """(n, j, k) of each recording to the used rows (N, k) of all, over the noise."""
        pairs = zip(parts, self._samples, strict=True)
        rows = np.concatenate([in_rows(part * open_[:, :, None]) for part, open_ in pairs])
        return (rows * self._weight[:, None])[self._used]


def _directions(columns: np.ndarray) -> np.ndarray:
    """Orthonormal directions (N, d) of columns (N, k)."""
    sizes = np.linalg.norm(columns, axis=0)
    columns = columns[:, sizes > 0.0] / sizes[sizes > 0.0]
    if not columns.size:
        return np.zeros((len(columns), 0))
    directions, triangle = np.linalg.qr(columns)
    turned, sizes, _ = np.linalg.svd(triangle)
    found: np.ndarray = directions @ turned[:, sizes > ROUNDING * sizes[0]]
    return found


def _tip(runs: Sequence[int]) -> Payload:
    return Payload(loads=(Load(runs=tuple(runs)),))
