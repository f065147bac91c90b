"""Content of the page and the summary of an identification."""

import platform
import shlex
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from importlib.metadata import PackageNotFoundError, version
from typing import NamedTuple

import numpy as np

from crane_identification.data.log import Log
from crane_identification.data.resample import Samples, resample
from crane_identification.estimation.regression import Rows, condition_numbers
from crane_identification.fitting import FitResult
from crane_identification.notation import NONE, percent, plain
from crane_identification.online.replay import Recursive
from crane_identification.options import Options
from crane_identification.preparation.run import Preparation
from crane_identification.signals.decimate import decimate
from crane_identification.signals.kalman import KalmanSmoother
from crane_identification.signals.motion import MotionEstimator, encoder_resolution
from crane_identification.signals.routes import ButterworthDifferentiator
from crane_identification.validation.force_validation import Validation, compare
from crane_identification.validation.motion_validation import (
    CommandValidation,
    MotionValidation,
    commands_validated,
    validate_motion,
)
from crane_model.cylinders import generalized_forces
from crane_model.model_file import Model

LARGEST_CONDITION = 1e12  # in SI units, that the arithmetic can tell
PACKAGES = (
    "crane_identification",
    "crane_model",
    "crane_driver",
    "numpy",
    "scipy",
    "numba",
    "filterpy",
    "cvxpy-base",
    "clarabel",
    "rosbags",
    "plotly",
)


@dataclass(frozen=True)
class Recording:
    """n samples of j joints; a row of NaN stands in each gap. None: not logged.

    `time` (n,) [s]; positions [rad or m], the estimated `velocity` [per s], the generalized
    `force` [N m or N] and the reference (n, j).
    """

    source: str
    time: np.ndarray
    position: np.ndarray
    velocity: np.ndarray
    force: np.ndarray
    reference_position: np.ndarray | None
    reference_velocity: np.ndarray | None


def recorded(
    model: Model, log: Log, motion: MotionEstimator | None, bandwidth: np.ndarray
) -> Recording:
    """The whole of `log`, not averaged: forces through (27) where the log holds pressures.

    What tunes itself is a Kalman smoother here, set to the `bandwidth` (j,) [Hz] found for the
    averaged motion, so that both are smoothed alike, and without another search.
    """
    samples = resample(log)
    force = _forces(model, samples)
    resolution = encoder_resolution(log.position.value)
    estimator = _tuned(motion, bandwidth, 1.0 / samples.rate)
    runs = [np.flatnonzero(samples.run == run) for run in np.unique(samples.run)]
    velocity = np.full_like(samples.position, np.nan)
    for rows in runs:
        estimate = estimator.estimate(samples.position[rows], 1.0 / samples.rate, resolution)
        velocity[rows] = estimate.velocity
    gaps = np.array([rows[-1] + 1 for rows in runs[:-1]], dtype=int)

    def opened(values: np.ndarray | None) -> np.ndarray | None:
        return None if values is None else np.insert(values, gaps, np.nan, axis=0)

    return Recording(
        source=log.source,
        time=np.insert(samples.time, gaps, samples.time[gaps - 1] + 1.0 / samples.rate),
        position=np.insert(samples.position, gaps, np.nan, axis=0),
        velocity=np.insert(velocity, gaps, np.nan, axis=0),
        force=np.insert(force, gaps, np.nan, axis=0),
        reference_position=opened(samples.reference_position),
        reference_velocity=opened(samples.reference_velocity),
    )


def _forces(model: Model, samples: Samples) -> np.ndarray:
    if samples.force is not None:
        return samples.force
    assert model.machine is not None and samples.pressure_a is not None  # the fit refused such logs
    assert samples.pressure_b is not None
    return generalized_forces(
        model.machine, samples.position, samples.pressure_a, samples.pressure_b, model.joints
    )


def _tuned(motion: MotionEstimator | None, bandwidth: np.ndarray, step: float) -> MotionEstimator:
    if isinstance(motion, ButterworthDifferentiator):
        return motion
    if isinstance(motion, KalmanSmoother) and motion.jerk_density is not None:
        return motion
    # With readings of unit noise, the density of the jerk alone sets the bandwidth.
    density = step * (2 * np.pi * bandwidth) ** 6
    return KalmanSmoother(tuple(density.tolist()), (1.0,) * len(bandwidth))


# Relative errors per joint over several recordings, and the scatter between periods.


@dataclass(frozen=True)
class JointErrors:
    """Shares of one, per joint (j,), over all samples of all recordings together.

    `relative` is ‖τ - τ̂‖/‖τ‖, `moving` the same over the samples at which the sign of the joint's
    velocity is known, `without_gravity` the error relative to τ without its gravity part, and
    `noise_floor` the scatter of τ from period to period (NaN where no period was repeated).
    """

    relative: np.ndarray
    moving: np.ndarray
    without_gravity: np.ndarray
    noise_floor: np.ndarray


def pooled(model: Model, validations: Sequence[Validation]) -> JointErrors:
    """Errors of `model` in at least one validation, as if the recordings were one."""
    measured = np.concatenate([v.measured for v in validations])
    error = measured - np.concatenate([v.predicted for v in validations])
    gravity = np.concatenate([v.gravity for v in validations])
    noise = np.sqrt(sum(len(v.time) * v.noise_floor**2 for v in validations))
    rows = Rows.stack([v.rows for v in validations])
    whole = np.linalg.norm(measured, axis=0)
    return JointErrors(
        relative=np.linalg.norm(error, axis=0) / whole,
        moving=rows.norms(rows.residual(model.theta)) / rows.norms(rows.force),
        without_gravity=np.linalg.norm(error, axis=0) / np.linalg.norm(measured - gravity, axis=0),
        noise_floor=noise / whole,
    )


def scatter(validation: Validation) -> np.ndarray | None:
    """Standard deviation of the averaged force (n, j) [N m or N].

    From the scatter between periods through the same filter; None if there was only one.
    """
    preparation, time = validation.preparation, validation.time
    count = len(preparation.periods)
    if count < 2:
        return None
    factor = round(float(time[1] - time[0]) / preparation.step)
    periods = [decimate(period, factor, preparation.periodic) for period in preparation.periods]
    return np.std(periods, axis=0, ddof=1) / np.sqrt(count)


def left_out(preparation: Preparation, joint: int) -> list[tuple[float, float]]:
    """Stretches of time [s] in which the sign of the joint's velocity is not known."""
    time, step = preparation.record.time, preparation.step
    still = ~preparation.moving[:, joint]
    edges = np.flatnonzero(np.diff(still, prepend=False, append=False)).reshape(-1, 2)
    return [(float(time[a]), float(time[b - 1] + step)) for a, b in edges]


@dataclass(frozen=True)
class Provenance:
    """Sources of a result; `date` as it is to be printed."""

    date: str
    command: str
    model_file: str
    versions: Mapping[str, str]

    @classmethod
    def of(cls, date: str, command: Sequence[str], model_file: str) -> "Provenance":
        """With the versions of Python and of the packages that the numbers depend on."""
        versions = {"Python": platform.python_version()}
        for package in PACKAGES:
            try:
                versions[package] = version(package)
            except PackageNotFoundError:  # run from the source tree
                versions[package] = "from source"
        return cls(date, shlex.join(command), model_file, versions)


@dataclass(frozen=True)
class IdentificationReport:
    """A fit, what it was made of, and its validation.

    `training` holds the recordings of `fit`, `validations` the predictions on recordings that it
    has not seen (none: not validated). `recursive` is the recursion over the same recordings.
    `seen_by_none` holds the recordings of `validations`.
    `true_values` gives those of parameters that are known, as on a simulated crane.
    """

    fit: FitResult
    options: Options
    training: tuple[Log, ...]
    validations: tuple[Validation, ...]
    warnings: tuple[str, ...]
    provenance: Provenance
    true_values: Mapping[str, float] | None = None
    recursive: Recursive | None = None
    seen_by_none: tuple[Log, ...] = ()

    @cached_property
    def held_out(self) -> JointErrors | None:
        """Errors on the validation recordings; None without any."""
        return pooled(self.fit.model, self.validations) if self.validations else None

    @cached_property
    def trained(self) -> JointErrors:
        """Errors on the training recordings, counted as the held-out ones: over all samples."""
        return pooled(self.fit.model, self.compared)

    @cached_property
    def compared(self) -> tuple[Validation, ...]:
        fit = self.fit
        return tuple(compare(fit.model, p, fit.decimation) for p in fit.preparations)

    @cached_property
    def recursive_held_out(self) -> JointErrors | None:
        """Errors of the recursive estimate on the validation recordings; None without either."""
        if self.recursive is None or not self.validations:
            return None
        model, factor = self.recursive.model, self.fit.decimation
        validations = [compare(model, v.preparation, factor) for v in self.validations]
        return pooled(model, validations)

    @cached_property
    def friction_share(self) -> np.ndarray:
        """How much of the drive force of the training data is friction: ‖friction‖/‖τ‖, (j,)."""
        model, records = self.fit.model, [p.record for p in self.fit.preparations]
        friction = np.concatenate([model.friction(record) for record in records])
        force = np.concatenate([record.force for record in records])
        return np.linalg.norm(friction, axis=0) / np.linalg.norm(force, axis=0)

    @cached_property
    def simulated(self) -> MotionValidation | None:
        """Simulated against measured motion on the validation recordings; None without any."""
        if not self.validations:
            return None
        return validate_motion(self.fit.model, [v.preparation.record for v in self.validations])

    @cached_property
    def commanded(self) -> tuple[CommandValidation, ...]:
        """The same from valve commands alone; none where the hydraulics are not known."""
        model = self.fit.model
        if model.hydraulics is None or not self.seen_by_none:
            return ()
        return commands_validated(model, self.seen_by_none, self.options)

    @property
    def training_bags(self) -> list[str]:
        return list(dict.fromkeys(log.source for log in self.training))

    @property
    def validation_bags(self) -> list[str]:
        return list(dict.fromkeys(v.source for v in self.validations))


# The recordings that went into a report: what each is and how well the model predicts it.


class SourceRow(NamedTuple):
    """One gapless run of a recording; `errors` of every joint, in percent."""

    source: str
    use: str
    period: str
    periods: str
    condition: str
    errors: list[str]


def source_rows(report: IdentificationReport) -> list[SourceRow]:
    """Training and validation, in the order they were given."""
    uses: dict[str, Sequence[Validation]] = {
        "training": report.compared,
        "validation": report.validations,
    }
    return [row for use, compared in uses.items() for row in _rows(use, compared)]


def _rows(use: str, compared: Sequence[Validation]) -> Iterator[SourceRow]:
    for compared_part in compared:
        averaging, record = compared_part.preparation.averaging, compared_part.preparation.record
        length = float(record.time[-1] - record.time[0]) + compared_part.preparation.step
        condition, _ = condition_numbers(compared_part.rows.stacked)
        yield SourceRow(
            source=compared_part.source,
            use=use,
            period=plain(averaging.period if averaging else length),
            periods=str(averaging.used) if averaging else NONE,
            condition=plain(condition if condition < LARGEST_CONDITION else np.inf),
            errors=[percent(float(error)) for error in compared_part.relative_error],
        )
