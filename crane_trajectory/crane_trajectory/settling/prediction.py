"""What a recording of a motion would hold, as far as a model and a hypothesis foretell it."""

from dataclasses import dataclass, replace

import numpy as np

from crane_model.errors import ConfigurationError
from crane_model.model_file import Model
from crane_model.open_question import OpenMember
from crane_model.record import Record
from crane_model.terms import Term, term_from_mapping
from crane_trajectory.motion.fourier import FourierTrajectory, MotionSamples
from crane_trajectory.motion.sweep import SweepTrajectory
from crane_trajectory.settling.pressures import steady_pressures

SAMPLES_A_ROW = 10  # of the motion, whose mean is a row
UNSURE = 0.1  # s around a reversal in which no row is used
STANDING = 0.01  # share of the largest speed of a motion, below which the sign is not known
OPEN = 0.5  # share of the samples of a row that must be used
STEP = 0.02  # relative, of the difference with respect to a shape parameter


@dataclass(frozen=True)
class Hypothesis:
    """An effect with its size: a term and the values (k,) of its parameters."""

    term: Term
    values: np.ndarray

    @classmethod
    def of(cls, member: OpenMember) -> "Hypothesis":
        """What a member of a question stands for; `ConfigurationError` if there is no such term."""
        try:
            return cls(term_from_mapping(member.term), np.array(member.values))
        except ValueError as error:
            raise ConfigurationError(
                f"{member.name} ({member.joint}): {error}; name its file by --terms, as for "
                "diagnose"
            ) from None

    def same_effect(self, other: "Hypothesis") -> bool:
        """Whether the other one is another law of the same effect, on the same joint."""
        together = _kinds(self.term) & _kinds(other.term)
        return bool(together) and self.term.only_joint == other.term.only_joint

    def bent(self) -> list[tuple[Term, Term, float]]:
        """Of each shape parameter: the term to either side of its value, and how far apart."""
        out = []
        for field in self.term.shapes:
            middle = float(getattr(self.term, field))
            ends = [
                self.term.model_validate({**self.term.model_dump(), field: middle * (1.0 + s)})
                for s in (-STEP, STEP)
            ]
            out.append((ends[0], ends[1], 2.0 * STEP))
        return out


def _kinds(term: Term) -> set[str]:
    """Types of the usual law of its effect, and of others of it."""
    if term.effect is None:
        return set(term.draws)
    return {term.effect.law_of or term.type, *term.effect.kin, *term.draws}


@dataclass(frozen=True)
class PlannedRecording:
    """Whole `periods` of a trajectory, with a known mass at the tip [kg], and with the pressure of
    the tank raised [Pa].
    """

    trajectory: FourierTrajectory | SweepTrajectory
    periods: int
    load: float = 0.0
    back_pressure: float = 0.0

    @property
    def duration(self) -> float:
        """Of the periods [s]."""
        return self.periods * self.trajectory.period

    def record(self, model: Model, row_rate: float, run: int) -> Record:
        """Its samples, without forces; `run` is its number."""
        rate = row_rate * SAMPLES_A_ROW
        time = np.arange(int(self.duration * rate)) / rate
        motion = self.trajectory.evaluate(time)
        columns = [self.trajectory.joint_names.index(joint) for joint in model.joints]
        motion = MotionSamples(*(np.ascontiguousarray(one[:, columns]) for one in motion))
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


def gate(record: Record, rate: float) -> np.ndarray:
    """(n, j): 1.0 where the sign of a velocity is known."""
    still = record.direction == 0.0
    turned = np.zeros_like(still)
    turned[1:] = record.direction[1:] * record.direction[:-1] < 0.0
    near = np.ones(2 * int(np.ceil(UNSURE * rate)) + 1)
    wrong = np.stack(
        [np.convolve(column, near, mode="same") for column in (still | turned).T.astype(float)],
        axis=1,
    )
    return (wrong < OPEN).astype(float)


def in_rows(values: np.ndarray) -> np.ndarray:
    """Means (rows, ...) of `SAMPLES_A_ROW` samples (n, ...) each."""
    whole = len(values) // SAMPLES_A_ROW * SAMPLES_A_ROW
    shape = (-1, SAMPLES_A_ROW, *values.shape[1:])
    means: np.ndarray = values[:whole].reshape(shape).mean(axis=1)
    return means
