"""Predicted against measured generalized force on recordings that the fit has not seen."""

from dataclasses import dataclass

import numpy as np

from crane_identification.preparation import Preparation
from crane_identification.regression import build_rows, noise_floor
from crane_identification.signals.decimate import decimate
from crane_model.model_file import Model


@dataclass(frozen=True)
class Validation:
    """How a model predicts one recording; all forces after the same zero-phase filter.

    `time` (n,) [s]; `measured`, `predicted` and the model's `gravity` part (n, j) [N m or N]. Per
    joint (j,): `relative_error` ‖τ - τ̂‖/‖τ‖ over all samples, the same relative to τ without
    gravity, the same over those samples at which the sign of the joint's velocity is known; and
    `noise_floor` [N m or N], the rms noise of the averaged force (NaN without two periods).
    """

    source: str
    joints: tuple[str, ...]
    time: np.ndarray
    measured: np.ndarray
    predicted: np.ndarray
    gravity: np.ndarray
    relative_error: np.ndarray
    relative_error_without_gravity: np.ndarray
    relative_error_moving: np.ndarray
    noise_floor: np.ndarray

    @property
    def relative_noise_floor(self) -> np.ndarray:
        """Noise floor over the rms of τ (j,): no model can predict better than this."""
        return self.noise_floor / np.sqrt((self.measured**2).mean(axis=0))


def compare(model: Model, preparation: Preparation, factor: int) -> Validation:
    """Prediction of an estimated `model` on a prepared recording, decimated by `factor`."""
    rows = build_rows(model, preparation, factor, gated=False)
    moving = build_rows(model, preparation, factor, gated=True)
    gravity = decimate(model.gravity(preparation.record), factor, preparation.periodic)
    error = rows.residual(model.theta)
    return Validation(
        source=preparation.source,
        joints=model.joints,
        time=rows.time,
        measured=rows.force,
        predicted=rows.force - error,
        gravity=gravity,
        relative_error=_ratio(error, rows.force),
        relative_error_without_gravity=_ratio(error, rows.force - gravity),
        relative_error_moving=moving.norms(moving.residual(model.theta))
        / moving.norms(moving.force),
        noise_floor=noise_floor(preparation, factor),
    )


def _ratio(part: np.ndarray, whole: np.ndarray) -> np.ndarray:
    return np.linalg.norm(part, axis=0) / np.linalg.norm(whole, axis=0)
