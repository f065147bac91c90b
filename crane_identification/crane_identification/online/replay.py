"""The same recursion over a recording."""

import numpy as np

from crane_identification.data.log import Log
from crane_identification.online.estimator import Forces, OnlineEstimator, OnlineOptions
from crane_identification.online.smoother import NANOSECONDS
from crane_identification.progress import Progress, silent
from crane_model.errors import DataError
from crane_model.model_file import Model

STEPS = 100  # of the progress


def replay(
    model: Model, log: Log, options: OnlineOptions | None = None, progress: Progress = silent
) -> tuple[OnlineEstimator, list[Forces]]:
    """The estimator after every reading of `log`, as if they came over topics, and the forces.

    Raises `DataError` if the log lacks pressures or has other joints than the model, and
    `ConfigurationError` as the estimator does.
    """
    if log.joints != model.joints:
        raise DataError(
            f"{log.source}: holds the joints {', '.join(log.joints)}, but the model has "
            f"{', '.join(model.joints)}; read the recording for the joints of the model"
        )
    if log.pressure_a is None or log.pressure_b is None:
        raise DataError(f"{log.source}: holds no chamber pressures; record /cylinder_pressures")
    estimator = OnlineEstimator(model, options)
    forces: list[Forces] = []
    encoder, oil = _stamps(log, log.position.time), _stamps(log, log.pressure_a.time)
    before = np.searchsorted(oil, encoder, side="right")  # pressures that came before
    fed = 0
    for i, stamp in enumerate(encoder):
        forces += _feed_pressures(estimator, log, oil, slice(fed, before[i]))
        fed = before[i]
        forces += estimator.add_position(int(stamp), log.position.value[i])
        if i % max(len(encoder) // STEPS, 1) == 0:
            progress("recursion", i / len(encoder))
    forces += _feed_pressures(estimator, log, oil, slice(fed, None))
    progress("recursion", 1.0)
    return estimator, forces


def _feed_pressures(
    estimator: OnlineEstimator, log: Log, stamps: np.ndarray, part: slice
) -> list[Forces]:
    assert log.pressure_a is not None and log.pressure_b is not None
    forces: list[Forces] = []
    samples = zip(stamps[part], log.pressure_a.value[part], log.pressure_b.value[part], strict=True)
    for stamp, chamber_a, chamber_b in samples:
        forces += estimator.add_pressure(int(stamp), chamber_a, chamber_b)
    return forces


def _stamps(log: Log, time: np.ndarray) -> np.ndarray:
    """(n,) [ns] on the clock of the recording, exactly as they were recorded."""
    return log.start + np.round(time * NANOSECONDS).astype(np.int64)
