"""Rows of (29) from prepared recordings: gated, filtered in parallel, decimated."""

from collections.abc import Sequence

import numpy as np

from crane_identification.estimation.rows import Rows
from crane_identification.preparation.averaging import noise_of_mean
from crane_identification.preparation.run import Preparation
from crane_identification.signals.decimate import (
    decimate,
    decimation_factor,
    decimation_rows,
    filtered_noise,
    trusted_bandwidth,
)
from crane_model.errors import DataError
from crane_model.model_file import Model
from crane_model.record import Record

OPEN = 0.5
"""A filtered row is used if at least this share of what the filter saw was let through."""


def common_factor(preparations: Sequence[Preparation], given: int | None = None) -> int:
    """The decimation factor that the least known motion of all allows, or the `given` one.

    `DataError` naming a recording in which no joint moves.
    """
    if given is not None:
        return given
    return min(_factor(one) for one in preparations)


def _factor(preparation: Preparation) -> int:
    try:
        bandwidth = trusted_bandwidth(preparation.bandwidth, preparation.moving)
    except DataError as error:
        raise DataError(f"{preparation.source}: {error}") from None
    return decimation_factor(bandwidth, preparation.step)


def build_rows(model: Model, preparation: Preparation, factor: int) -> Rows:
    """Φ and τ of one recording, both through the same zero-phase filter and decimation.

    Both sides are first set to 0 where the sign of the joint's velocity is not known, which keeps
    (28) exact and keeps the filter from spreading the errors made there; rows that are mostly
    empty are not used.
    """
    record = preparation.record
    assert record.force is not None  # prepare() refuses such recordings
    gate = preparation.moving.astype(float)
    matrix = _columns(model, preparation, record, factor)
    deviation = (preparation.periods - preparation.periods.mean(axis=0)) * preparation.moving
    scatter = np.stack([decimate(one, factor, preparation.periodic) for one in deviation])
    kept = decimation_rows(len(gate), factor)
    return Rows(
        joints=model.joints,
        names=tuple(parameter.name for parameter in model.parameters),
        units=tuple(parameter.unit for parameter in model.parameters),
        time=record.time[kept],
        run=np.zeros(len(kept), dtype=int),
        matrix=matrix,
        force=decimate(record.force * gate, factor, preparation.periodic),
        used=decimate(gate, factor, preparation.periodic) > OPEN,
        scatter=(scatter,),
        filtered=filtered_noise(factor),
    )


def instruments(model: Model, preparation: Preparation, factor: int) -> np.ndarray:
    """Φ (n, j, p) along the reference, gated and filtered as the rows of the same recording.

    `DataError` where the reference was not recorded.
    """
    if preparation.reference is None:
        raise DataError(
            f"{preparation.source}: instrumental variables need the reference position, velocity "
            f"and acceleration (/joint_reference); record it, or choose another estimator"
        )
    return _columns(model, preparation, preparation.reference, factor)


def _columns(model: Model, preparation: Preparation, record: Record, factor: int) -> np.ndarray:
    gate = preparation.moving[:, :, np.newaxis]
    return decimate(model.regressor(record) * gate, factor, preparation.periodic)


def noise_floor(preparation: Preparation, factor: int) -> np.ndarray:
    """Root mean square noise (j,) [N m or N] of the filtered, averaged generalized force.

    From the scatter between periods, so free of any model; NaN without two periods.
    """
    periods = np.stack([decimate(one, factor, preparation.periodic) for one in preparation.periods])
    return noise_of_mean(periods, np.ones(periods.shape[1:], dtype=bool))
