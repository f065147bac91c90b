"""Rows of (29) from prepared recordings: gated, filtered in parallel, decimated."""

from collections.abc import Sequence

import numpy as np

from crane_identification.averaging import noise_of_mean
from crane_identification.estimation.rows import Rows
from crane_identification.preparation import Preparation
from crane_identification.signals.decimate import decimate, decimation_factor, decimation_rows
from crane_identification.signals.gate import trusted_bandwidth
from crane_model.model_file import Model

OPEN = 0.5
"""A filtered row is used if at least this share of what the filter saw was let through."""


def common_factor(preparations: Sequence[Preparation], given: int | None = None) -> int:
    """The decimation factor that the least known motion of all allows, or the `given` one."""
    if given is not None:
        return given
    return min(
        decimation_factor(trusted_bandwidth(p.bandwidth, p.moving), p.step) for p in preparations
    )


def build_rows(model: Model, preparation: Preparation, factor: int) -> Rows:
    """Φ and τ of one recording, both through the same zero-phase filter and decimation.

    Both sides are first set to 0 where the sign of the joint's velocity is not known, which keeps
    (28) exact and keeps the filter from spreading the errors made there; rows that are mostly
    empty are not used.
    """
    record = preparation.record
    assert record.force is not None  # prepare() refuses such recordings
    gate = preparation.moving.astype(float)
    matrix = model.regressor(record) * gate[:, :, np.newaxis]
    kept = decimation_rows(len(record), factor)
    return Rows(
        joints=model.joints,
        names=tuple(parameter.name for parameter in model.parameters),
        units=tuple(parameter.unit for parameter in model.parameters),
        time=record.time[kept],
        run=np.zeros(len(kept), dtype=int),
        matrix=decimate(matrix, factor, preparation.periodic),
        force=decimate(record.force * gate, factor, preparation.periodic),
        used=decimate(gate, factor, preparation.periodic) > OPEN,
    )


def noise_floor(preparation: Preparation, factor: int) -> np.ndarray:
    """Root mean square noise (j,) [N m or N] of the filtered, averaged generalized force.

    From the scatter between periods, so free of any model; NaN without two periods.
    """
    periods = np.stack([decimate(one, factor, preparation.periodic) for one in preparation.periods])
    return noise_of_mean(periods, np.ones(periods.shape[1:], dtype=bool))
