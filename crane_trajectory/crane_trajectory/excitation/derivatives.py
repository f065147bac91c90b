"""Derivatives of regressor columns with respect to the motion, summed with weights.

Every criterion of (35) is a function of Phi^T Phi. Its derivative with respect to the motion is
sum_jk weight_njk dPhi_njk / d(q, q', q'') at each sample n: the regressor pulled back by a weight.
The terms of rigid bodies and all `motion_columns` have closed forms; for any other term of one
instant, differences of fourth order, which are exact to rounding where the term is smooth.
"""

from dataclasses import replace

import numpy as np

from crane_model import motion_columns
from crane_model.errors import ConfigurationError
from crane_model.model_file import Model
from crane_model.record import Record
from crane_model.terms import Setting, Term
from crane_trajectory.motion.fourier import MotionSamples

STEP = 1e-3  # rad, m and their derivatives: rounding and truncation of the stencil are alike
STENCIL = ((-2, 1 / 12), (-1, -2 / 3), (1, 2 / 3), (2, -1 / 12))


def smooth_record(model: Model, motion: MotionSamples, width: np.ndarray) -> Record:
    """Samples (n, j) as the model takes them, with tanh(q' / width) for sgn(q'); width (j,)."""
    return Record(
        joints=model.joints,
        time=np.arange(len(motion.position), dtype=float),
        position=motion.position,
        velocity=motion.velocity,
        acceleration=motion.acceleration,
        direction_known=np.tanh(motion.velocity / width),
    )


def smooth_regressor(model: Model, record: Record) -> np.ndarray:
    """Phi (n, j, p) on a `smooth_record`, with q' tanh(q' / width) for |q'| as well."""
    regressor = np.zeros((*record.position.shape, len(model.parameters)))
    model.fill(record, regressor, smooth=True)
    return regressor


def pull_back(model: Model, record: Record, weight: np.ndarray, width: np.ndarray) -> MotionSamples:
    """sum_jk weight_njk dPhi_njk / d(q, q', q'') of `smooth_regressor`: three arrays (n, j).

    weight (n, j, p); `record` is one of `smooth_record` with the same `width`. Raises
    `ConfigurationError` for a term whose force depends on more than the motion at the instant.
    """
    total = np.zeros((3, *record.position.shape))
    for term, columns in model.whole_terms:
        if not term.of_one_instant:
            raise ConfigurationError(
                f"model '{model.name}': term '{term.type}' depends on more than the motion at one "
                "instant; leave it out of the model for which a trajectory is designed"
            )
        given = weight[:, :, columns]
        slopes = term.pull_back(record, model.setting, given)
        if slopes is None:
            slopes = _by_differences(term, model.setting, record, width, given)
        total += slopes
    steepness = (1.0 - record.direction**2) / width
    motion_columns.pull_back(model.motion_columns, record, steepness, weight, total)
    return MotionSamples(*total)


def _by_differences(
    term: Term, setting: Setting, record: Record, width: np.ndarray, weight: np.ndarray
) -> np.ndarray:
    """(3, n, j): derivatives with respect to q, q' and q'' of the columns of a term, summed with
    weights (n, j, p).
    """
    slopes = np.zeros((3, *record.position.shape))
    one = term.only_joint
    for j in range(len(width)) if one is None else [record.column(one)]:

        def weighted(quantity: str, shift: float, j: int = j) -> np.ndarray:
            shifted = getattr(record, quantity).copy()
            shifted[:, j] += shift
            moved = {quantity: shifted}
            if quantity == "velocity":
                moved["direction_known"] = np.tanh(shifted / width)
            columns = term.columns(replace(record, **moved), setting)
            total: np.ndarray = np.einsum("njp,njp->n", weight, columns)
            return total

        for slope, quantity in zip(slopes, ("position", "velocity", "acceleration"), strict=True):
            shares = [factor * weighted(quantity, k * STEP) for k, factor in STENCIL]
            slope[:, j] = np.sum(shares, axis=0) / STEP
    return slopes
