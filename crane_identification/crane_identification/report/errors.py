"""Relative errors per joint over several recordings, and the scatter between periods."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from crane_identification.estimation.rows import Rows
from crane_identification.preparation.run import Preparation
from crane_identification.signals.decimate import decimate
from crane_identification.validation.force_validation import Validation
from crane_model.model_file import Model


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
    preparation, factor = validation.preparation, _factor(validation)
    count = len(preparation.periods)
    if count < 2:
        return None
    periods = [decimate(one, factor, preparation.periodic) for one in preparation.periods]
    return np.std(periods, axis=0, ddof=1) / np.sqrt(count)


def left_out(preparation: Preparation, joint: int) -> list[tuple[float, float]]:
    """Stretches of time [s] in which the sign of the joint's velocity is not known."""
    time, step = preparation.record.time, preparation.step
    still = ~preparation.moving[:, joint]
    edges = np.flatnonzero(np.diff(still, prepend=False, append=False)).reshape(-1, 2)
    return [(float(time[a]), float(time[b - 1] + step)) for a, b in edges]


def _factor(validation: Validation) -> int:
    """By how much the forces of a validation are decimated."""
    return round(float(validation.time[1] - validation.time[0]) / validation.preparation.step)
