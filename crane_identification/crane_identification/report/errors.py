"""Relative errors per joint over several recordings, and the scatter between periods."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from crane_identification.preparation import Preparation
from crane_identification.signals.decimate import decimate
from crane_identification.validation import Validation


@dataclass(frozen=True)
class JointErrors:
    """Shares of one, per joint (j,), over all samples of all recordings together.

    `relative` is ‖τ - τ̂‖/‖τ‖, `without_gravity` the same relative to τ without its gravity part,
    `noise_floor` the share that noise alone causes (NaN where no period was repeated).
    """

    relative: np.ndarray
    without_gravity: np.ndarray
    noise_floor: np.ndarray


def pooled(validations: Sequence[Validation]) -> JointErrors:
    """Errors of at least one validation, as if the recordings were one."""
    measured = np.concatenate([v.measured for v in validations])
    error = measured - np.concatenate([v.predicted for v in validations])
    gravity = np.concatenate([v.gravity for v in validations])
    noise = np.sqrt(sum(len(v.time) * v.noise_floor**2 for v in validations))
    whole = np.linalg.norm(measured, axis=0)
    return JointErrors(
        relative=np.linalg.norm(error, axis=0) / whole,
        without_gravity=np.linalg.norm(error, axis=0) / np.linalg.norm(measured - gravity, axis=0),
        noise_floor=noise / whole,
    )


def scatter(preparation: Preparation, validation: Validation) -> np.ndarray | None:
    """Standard deviation of the averaged force (n, j) at the times of `validation` [N m or N].

    From the scatter between periods through the same filter; None if there was only one.
    """
    count = len(preparation.periods)
    if count < 2:
        return None
    factor = round(float(validation.time[1] - validation.time[0]) / preparation.step)
    periods = [decimate(one, factor, preparation.periodic) for one in preparation.periods]
    return np.std(periods, axis=0, ddof=1) / np.sqrt(count)


def left_out(preparation: Preparation, joint: int) -> list[tuple[float, float]]:
    """Stretches of time [s] in which the sign of the joint's velocity is not known."""
    time, step = preparation.record.time, preparation.step
    still = ~preparation.moving[:, joint]
    edges = np.flatnonzero(np.diff(still, prepend=False, append=False)).reshape(-1, 2)
    return [(float(time[a]), float(time[b - 1] + step)) for a, b in edges]
