"""The gap between model and measurement on recordings that took no part, before and after."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import SupportsIndex

import numpy as np

from crane_identification.diagnosis.fit.evidence import Evidence, over_zones, relative, residual
from crane_identification.diagnosis.proof.learner import predict_elsewhere
from crane_identification.diagnosis.proof.noise import scatter_of_periods, scatter_of_samples
from crane_identification.diagnosis.search.loads import Weighed, with_own_loads
from crane_identification.preparation.run import Preparation
from crane_identification.thresholds import Gates, Method
from crane_identification.validation.motion_validation import MotionValidation, validate_motion
from crane_model.model_file import Model

RESOLUTION = 1e-6  # relative error, below which numbers are rounding


@dataclass(frozen=True)
class HeldOut:
    """Per joint (j,), relative to the rms of the force: error `before` and `after`, the `floor` of
    noise (NaN where no period was repeated), and the `best` that a flexible learner reaches. The
    `method` says what is a gap.
    """

    joints: tuple[str, ...]
    before: np.ndarray
    after: np.ndarray
    floor: np.ndarray
    best: np.ndarray
    method: Method

    @property
    def reachable(self) -> np.ndarray:
        """What some model reaches (j,): noise where it is known, or the learner, or that `after`.

        Periods scatter by what the motion does not repeat as well, which a model may explain.
        """
        return np.fmin(np.fmin(self.method.clean_factor * self.floor, self.best), self.after)

    @property
    def closed(self) -> np.ndarray:
        """Share (j,) of the explainable gap, in energy, that is closed; NaN where there is none."""
        return np.array([self.closed_on([j]) for j in range(len(self.joints))])

    def closed_on(self, joints: Sequence[int]) -> float:
        """The same of several joints together, each in units of what is reachable there."""
        own = list(joints)
        unit = np.maximum(self.reachable[own], RESOLUTION) ** 2
        before, after, least = (
            float((error[own] ** 2 / unit).sum())
            for error in (self.before, self.after, self.reachable)
        )
        explainable = before - least
        gap = explainable > self.method.explainable_share * before
        return (before - after) / explainable if gap else np.nan

    def moved(self, j: SupportsIndex) -> str:
        """What becomes of the held-out error of a joint, in words; one number where both are one.

        So that a percentage does not fall to itself.
        """
        before, after = (f"{error[j]:.2%}" for error in (self.before, self.after))
        if before == after:
            return f"the held-out error of {self.joints[j]} stays at {after}"
        verb = "falls" if self.after[j] < self.before[j] else "rises"
        return f"the held-out error of {self.joints[j]} {verb} from {before} to {after}"

    def is_noise(self, joints: Sequence[int]) -> bool:
        """Whether the errors of these joints before are as small as the noise that is known."""
        own = list(joints)
        return bool((self.before[own] <= self.method.clean_factor * self.floor[own]).all())


@dataclass(frozen=True)
class Gap(HeldOut):
    """Errors of all held-out rows and, in `trained`, of those where training went.

    `training_before` and `training_after`: errors on the recordings that models were fitted to.
    `uncertain`: error that the standard deviations of values that are kept allow. `motion_before`
    and `motion_after`: errors of the simulated motion. `loads` of the held-out recordings, which
    `carried` holds beside what the model after has. `sample_noise`: that of the held-out force, by
    its scatter from sample to sample, over its rms.
    """

    training_before: np.ndarray
    training_after: np.ndarray
    motion_before: MotionValidation
    motion_after: MotionValidation
    loads: tuple[Weighed, ...]
    carried: Model
    sample_noise: np.ndarray
    uncertain: np.ndarray | float = 0.0
    trained: HeldOut | None = None

    @property
    def held_to(self) -> HeldOut:
        """What a name is held to: of an end that training did not visit, no law can be known."""
        return self.trained or self

    @property
    def largest_before(self) -> np.ndarray:
        """The larger one of held-out and training error before (j,)."""
        return np.maximum(self.before, self.training_before)

    def over_floor(self, errors: np.ndarray) -> np.ndarray:
        """Errors (j,) over the noise floor; NaN where none is known."""
        return errors / np.maximum(self.floor, RESOLUTION)

    def over_samples(self, errors: np.ndarray) -> np.ndarray:
        """Errors (j,) over what the scatter of samples and surveyed lengths account for."""
        return errors / np.hypot(self.sample_noise, self.method.surveyed_error)

    def beyond_noise(self, errors: np.ndarray, gates: Gates) -> np.ndarray:
        """Whether errors (j,) are more than the noise of recordings that repeat a motion, by a
        factor, more than values that are kept may err, and more than lengths leave that were
        surveyed.
        """
        beyond: np.ndarray = (
            (self.over_floor(errors) > gates.floor_factor)
            & (errors > gates.floor_factor * self.uncertain)
            & (errors > self.method.surveyed_error)
        )
        return beyond

    def beyond_samples(self, errors: np.ndarray, gates: Gates) -> np.ndarray:
        """Whether errors (j,) are more than nothing missing leaves, by the scatter of samples: also
        where no period repeats, or does and scatters with an effect that comes and goes.
        """
        beyond: np.ndarray = (self.over_samples(errors) > gates.sample_noise_factor) & (
            errors > gates.floor_factor * self.uncertain
        )
        return beyond


def measure(
    before: Model,
    after: Model,
    training: Evidence,
    held_out: Evidence,
    averaged: Sequence[Preparation],
    method: Method,
) -> Gap:
    """Both models, fitted to the training recordings, on the held-out ones.

    The one after with the load of each of these, which is a property of that recording.
    """
    j = len(before.joints)
    noise = scatter_of_periods(averaged, held_out.runs[0].factor, j)
    doubt = uncertain(held_out, after) if training.keeps else 0.0
    after, loads = with_own_loads(after, training, held_out)
    old, new = residual(held_out, before), residual(held_out, after)
    learnt = np.minimum(np.abs(old), np.abs(new))  # close to reversals, what the better one leaves
    seen = training.moving
    fitted = residual(training, before)
    learnt[:, :j] = predict_elsewhere(seen, fitted[:, :j], held_out.moving) - old[:, :j]
    everywhere, trained = (
        _errors(rows, (old, new, learnt), noise, method)
        for rows in (held_out, where_trained(training, held_out))
    )
    records = [run.record for run in held_out.runs]
    moved = validate_motion(before, records)
    return Gap(
        **vars(everywhere),
        training_before=relative(training, fitted),
        training_after=relative(training, residual(training, after)),
        motion_before=moved,
        motion_after=moved if after is before else validate_motion(after, records),
        loads=loads,
        carried=after,
        sample_noise=scatter_of_samples(held_out) / _size(held_out),
        uncertain=doubt,
        trained=trained,
    )


def _errors(
    rows: Evidence, left: Sequence[np.ndarray], noise: np.ndarray, method: Method
) -> HeldOut:
    """Of the used rows: what is `left` (n, c) before, after and by the learner; `noise` (j,)."""
    size = _size(rows)
    before, after, best = (over_zones(rows, values) / size for values in left)
    return HeldOut(rows.joints, before, after, noise / size, np.minimum(best, before), method)


def _size(rows: Evidence) -> np.ndarray:
    """Of the force (j,), above 0."""
    return np.maximum(over_zones(rows, rows.force), np.finfo(float).tiny)


def where_trained(training: Evidence, held_out: Evidence) -> Evidence:
    """The held-out rows that see each joint within the range that it went through in training."""
    joints = len(training.joints)
    used = training.used.reshape(len(training.time), -1, joints).any(axis=1)
    q = np.concatenate([run.record.position[run.kept] for run in training.runs])
    low = np.where(used, q, np.inf).min(axis=0)
    high = np.where(used, q, -np.inf).max(axis=0)
    beyond = []
    for run in held_out.runs:
        outside = (run.record.position < low) | (run.record.position > high)
        beyond.append(run.reached(outside & (low <= high)))
    zones = held_out.used.shape[1] // joints
    return replace(held_out, used=held_out.used & ~np.tile(np.concatenate(beyond), zones))


def uncertain(evidence: Evidence, model: Model) -> np.ndarray:
    """Error (j,) of the force, relative to it, that the standard deviations of values make."""
    assert model.std_devs is not None  # of values that are kept
    parts = evidence.regressor(model) * model.std_devs
    return relative(evidence, np.linalg.norm(parts, axis=2))
