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
    k, every = 0, max(len(encoder) // STEPS, 1)
    for i, stamp in enumerate(encoder):
        while k < len(oil) and oil[k] <= stamp:
            forces += _feed_pressure(estimator, log, oil, k)
            k += 1
        forces += estimator.add_position(int(stamp), log.position.value[i])
        if i % every == 0:
            progress("recursion", i / len(encoder))
    for k in range(k, len(oil)):
        forces += _feed_pressure(estimator, log, oil, k)
    progress("recursion", 1.0)
    return estimator, forces


def _feed_pressure(
    estimator: OnlineEstimator, log: Log, stamps: np.ndarray, k: int
) -> list[Forces]:
    assert log.pressure_a is not None and log.pressure_b is not None
    return estimator.add_pressure(int(stamps[k]), log.pressure_a.value[k], log.pressure_b.value[k])


def _stamps(log: Log, time: np.ndarray) -> np.ndarray:
    """(n,) [ns] on the clock of the recording, exactly as they were recorded."""
    return log.start + np.round(time * NANOSECONDS).astype(np.int64)
