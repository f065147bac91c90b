"""Predicted against measured generalized force on recordings that the fit has not seen."""

from dataclasses import dataclass

import numpy as np

from crane_identification.estimation.regression import build_rows, noise_floor
from crane_identification.estimation.rows import Rows
from crane_identification.preparation.run import Preparation
from crane_identification.signals.decimate import decimate, decimation_rows
from crane_identification.signals.response import smoothed_alike
from crane_model.model_file import Model


@dataclass(frozen=True)
class Validation:
    """How a model predicts one recording; all forces after the same zero-phase filter.

    `rows`: the equations that a fit would use of it. `time` (n,) [s]; `measured`, `predicted` and
    the model's `gravity` part (n, j) [N m or N]. Where a joint stands or turns back, friction (13)
    may be anything between its two branches: the prediction there is the force in that range
    nearest to the measured one, which costs nothing only if the measured force is one that the
    model allows. That one is smoothed as the motion is: what the smoother takes from a short
    acceleration it gives to its surroundings, and the filter cancels the two only if both count.

    Per joint (j,): `relative_error` ‖τ - τ̂‖/‖τ‖ over all samples; `relative_error_moving`, the same
    over the share `moving` of them at which the sign of the joint's velocity is known; and
    `noise_floor` [N m or N], the rms noise of the averaged force (NaN without two periods).
    """

    preparation: Preparation
    rows: Rows
    joints: tuple[str, ...]
    time: np.ndarray
    measured: np.ndarray
    predicted: np.ndarray
    gravity: np.ndarray
    relative_error: np.ndarray
    relative_error_without_gravity: np.ndarray
    relative_error_moving: np.ndarray
    moving: np.ndarray
    noise_floor: np.ndarray

    @property
    def source(self) -> str:
        """Name of the recording."""
        return self.preparation.source

    @property
    def relative_noise_floor(self) -> np.ndarray:
        """Noise floor over the rms of τ (j,): the scatter of the averaged force."""
        return self.noise_floor / np.sqrt((self.measured**2).mean(axis=0))


def compare(model: Model, preparation: Preparation, factor: int) -> Validation:
    """Prediction of an estimated `model` on a prepared recording, decimated by `factor`."""
    record = preparation.record
    assert record.force is not None  # prepare() refuses such recordings

    def filtered(force: np.ndarray) -> np.ndarray:
        return decimate(force, factor, preparation.periodic)

    bandwidth = np.where(preparation.moving.any(axis=0), preparation.bandwidth, np.inf)
    alike = smoothed_alike(record.force, bandwidth, preparation.step, preparation.periodic)
    allowed = np.clip(alike, *model.range_at_standstill(record))
    measured = filtered(record.force)
    predicted = filtered(np.where(preparation.signed, model.predict(record), allowed))
    gravity = filtered(model.gravity(record))
    rows = build_rows(model, preparation, factor)
    return Validation(
        preparation=preparation,
        rows=rows,
        joints=model.joints,
        time=record.time[decimation_rows(len(record), factor)],
        measured=measured,
        predicted=predicted,
        gravity=gravity,
        relative_error=_ratio(measured - predicted, measured),
        relative_error_without_gravity=_ratio(measured - predicted, measured - gravity),
        relative_error_moving=rows.norms(rows.residual(model.theta)) / rows.norms(rows.force),
        moving=preparation.moving.mean(axis=0),
        noise_floor=noise_floor(preparation, factor),
    )


def _ratio(part: np.ndarray, whole: np.ndarray) -> np.ndarray:
    return np.linalg.norm(part, axis=0) / np.linalg.norm(whole, axis=0)
