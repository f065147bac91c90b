"""Predicted against measured generalized force on recordings that the fit has not seen."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from crane_identification.estimation.regression import (
    Rows,
    balancing,
    build_rows,
    noise_floor,
    solve_weighted,
)
from crane_identification.notation import listed, short_percent, spoken
from crane_identification.preparation.run import Preparation
from crane_identification.signals.decimate import decimate, decimation_rows
from crane_identification.signals.motion import smoothed_alike
from crane_model.model_file import Model

WORSE_ELSEWHERE = 1.5
"""Held-out error over that of the training and its noise, above which a model does not carry over.
"""
LEFT_OUT_PARTS = 4
"""Parts of each recording, each left out in turn."""
WORSE_LEFT_OUT = 3.0
"""Error where left out over that of the fit, above which recordings do not determine a model. Of a
robot with six axes: 2.4 and 1.6 of two and three recordings that do, 6 and 20 of single ones."""
VISIBLE_ERROR = 0.03
"""Share of the force below which an error is none to speak of."""
FLAT = 0.05
"""Width of a motion in one direction of the joints' space, over the mean width of a joint, below
which it does not count. Of the robot: 0.003 to 0.03 against 0.19 and more."""


@dataclass(frozen=True)
class Validation:
    """Predicted against measured forces of one gapless run, behind the same zero-phase filter.

    At standstill friction (13) may be anything between its two branches: the prediction is then the
    allowed force nearest to the measured one, smoothed as the motion is.

    Parameters
    ----------
    preparation : Preparation
        The prepared run.
    rows : Rows
        The equations that a fit would use of it.
    joints : tuple of str
        Names of the j joints.
    time : ndarray, shape (n,)
        Times [s].
    measured, predicted, gravity : ndarray, shape (n, j)
        Forces, and the model's gravity part [N m or N].
    relative_error : ndarray, shape (j,)
        ‖τ - τ̂‖/‖τ‖ over all samples.
    noise_floor : ndarray, shape (j,)
        Rms noise of the averaged force [N m or N]; NaN without two periods.
    """

    preparation: Preparation
    rows: Rows
    joints: tuple[str, ...]
    time: np.ndarray
    measured: np.ndarray
    predicted: np.ndarray
    gravity: np.ndarray
    relative_error: np.ndarray
    noise_floor: np.ndarray

    @property
    def source(self) -> str:
        """Name of the recording."""
        return self.preparation.source


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
        relative_error=np.linalg.norm(measured - predicted, axis=0)
        / np.linalg.norm(measured, axis=0),
        noise_floor=noise_floor(preparation, factor),
    )


def elsewhere(
    joints: Sequence[str], held_out: np.ndarray, trained: np.ndarray, noise_floor: np.ndarray
) -> tuple[str, ...]:
    """A warning, if any, of the joints on which the model errs clearly more on those held out.

    Errors (j,) and `noise_floor` (j,), NaN where it is not known, are relative to the force.
    """
    expected = WORSE_ELSEWHERE * np.hypot(trained, np.nan_to_num(noise_floor))
    worse = [
        f"by {short_percent(float(there))} on the {spoken(joint)} "
        f"({short_percent(float(here))} in training)"
        for joint, there, here, limit in zip(joints, held_out, trained, expected, strict=True)
        if there > limit
    ]
    if not worse:
        return ()
    return (
        f"The model does not carry over to the held-out recordings: there it errs {listed(worse)}. "
        "The machine changed, the motion differs, or an effect is missing; diagnose --fixed, with "
        "these recordings as --train, finds the change.",
    )


# Do the training recordings determine the model, or only what they happened to ask of it?
#
# A fit that is good on its own recordings may be wrong on others, where some joints always moved
# alike: then only combinations of parameters are known, though well enough for a small residual.


def undetermined(rows: Rows, trained: np.ndarray, preparations: Sequence[Preparation]) -> str:
    """A warning if parts of the training recordings do not predict the others; else empty.

    `trained` (j,) is the error of the fit relative to the force.
    """
    left = left_out(rows)
    worse = [
        f"{spoken(joint)} {short_percent(float(there))} against {short_percent(float(here))}"
        for joint, there, here in zip(rows.joints, left, trained, strict=True)
        if there > max(WORSE_LEFT_OUT * here, VISIBLE_ERROR)
    ]
    if not worse:
        return ""
    count, joints = spanned(preparations), len(rows.joints)
    alike = (
        f" The joints move together: their motion spans {count} of {joints} dimensions."
        if count < joints
        else ""
    )
    return (
        "These recordings do not determine the model: a quarter that is left out is predicted "
        f"worse than it is fitted ({listed(worse)}).{alike} Add recordings of other motions, or "
        "what is known beforehand (--prior)."
    )


def left_out(rows: Rows) -> np.ndarray:
    """Error (j,) over the force, each part predicted by the others; NaN with too few rows."""
    weights = balancing(rows)
    part = np.empty(len(rows.run), dtype=int)
    for run in np.unique(rows.run):
        of_run = np.flatnonzero(rows.run == run)
        part[of_run] = np.arange(len(of_run)) * LEFT_OUT_PARTS // len(of_run)
    errors, forces = np.zeros((2, len(rows.joints)))
    for k in range(LEFT_OUT_PARTS):
        training, held_out = _of(rows, part != k), _of(rows, part == k)
        if training.samples <= len(rows.names):
            return np.full(len(rows.joints), np.nan)
        values = solve_weighted(training, weights).values
        errors += held_out.norms(held_out.residual(values)) ** 2
        forces += held_out.norms(held_out.force) ** 2
    return np.sqrt(np.divide(errors, forces, out=np.full_like(errors, np.nan), where=forces > 0.0))


def spanned(preparations: Sequence[Preparation]) -> int:
    """In how many directions of the joints' space the motion is wide."""
    position = np.concatenate([preparation.record.position for preparation in preparations])
    deviation = position - position.mean(axis=0)
    width = deviation.std(axis=0)
    scaled = deviation / np.where(width > 0.0, width, 1.0)
    singular = np.linalg.svd(scaled, compute_uv=False) / np.sqrt(len(scaled))
    return int((singular > FLAT).sum())


def _of(rows: Rows, chosen: np.ndarray) -> Rows:
    return replace(rows, used=rows.used & chosen[:, np.newaxis])
