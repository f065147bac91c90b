"""The same recursion over recordings."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from crane_identification.data.log import Log
from crane_identification.online.estimator import Forces, OnlineEstimator, OnlineOptions
from crane_identification.online.smoother import NANOSECONDS
from crane_identification.progress import Progress, silent
from crane_model.errors import DataError
from crane_model.model_file import Model

PARTS = 20  # of a recording, after each of which the estimate is read


@dataclass(frozen=True)
class Recursive:
    """The recursion over several recordings: the `model` with its estimate from `samples` rows.

    On the way there, at k moments: `time` (k,) [s] of recordings so far, `values` and `std_devs`
    (k, p); NaN and inf while a parameter was not determined.
    """

    model: Model
    samples: int
    time: np.ndarray
    values: np.ndarray
    std_devs: np.ndarray


def replay(
    model: Model, log: Log, options: OnlineOptions | None = None, progress: Progress = silent
) -> tuple[OnlineEstimator, list[Forces]]:
    """The estimator after every reading of `log`, as if they came over topics, and the forces.

    Raises `DataError` if the log lacks pressures or has other joints than the model, and
    `ConfigurationError` as the estimator does.
    """
    estimator = OnlineEstimator(model, options)
    forces: list[Forces] = []
    for done, part in enumerate(_feed(estimator, log), start=1):
        forces += part
        progress("recursion", done / PARTS)
    return estimator, forces


def recursion(
    model: Model,
    logs: Sequence[Log],
    options: OnlineOptions | None = None,
    progress: Progress = silent,
) -> Recursive:
    """One estimator over all `logs`, played one after the other.

    Raises as `replay` does, and `DataError` if even all of them leave a parameter undetermined.
    """
    estimator = OnlineEstimator(model, options)
    begin, time, solutions = 0.0, [], []
    for number, log in enumerate(logs):
        duration = float(log.position.time[-1])
        for done, _ in enumerate(_feed(estimator, log), start=1):
            time.append(begin + duration * done / PARTS)
            solutions.append(estimator.solve())
            progress("recursion", (number + done / PARTS) / len(logs))
        begin += duration
    return Recursive(
        model=estimator.fitted_model(),
        samples=estimator.samples,
        time=np.array(time),
        values=np.array([solution.values for solution in solutions]),
        std_devs=np.array([solution.std_devs for solution in solutions]),
    )


def _feed(estimator: OnlineEstimator, log: Log) -> Iterator[list[Forces]]:
    """Every reading of `log` in the order of stamps; the forces that each part of it completes."""
    model = estimator.model
    if log.joints != model.joints:
        raise DataError(
            f"{log.source}: holds the joints {', '.join(log.joints)}, but the model has "
            f"{', '.join(model.joints)}; read the recording for the joints of the model"
        )
    if log.pressure_a is None or log.pressure_b is None:
        raise DataError(f"{log.source}: holds no chamber pressures; record /cylinder_pressures")
    encoder, oil = _stamps(log, log.position.time), _stamps(log, log.pressure_a.time)
    before = np.searchsorted(oil, encoder, side="right")  # pressures that came before
    fed = 0
    for part in np.array_split(np.arange(len(encoder)), PARTS):
        forces: list[Forces] = []
        for i in part:
            forces += _feed_pressures(estimator, log, oil, slice(fed, before[i]))
            fed = before[i]
            forces += estimator.add_position(int(encoder[i]), log.position.value[i])
        if part[-1:] == len(encoder) - 1:
            forces += _feed_pressures(estimator, log, oil, slice(fed, None))
        yield forces


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
