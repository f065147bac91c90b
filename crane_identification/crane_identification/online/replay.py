"""The recursion of the node over recordings, at once or in a process of its own."""

import signal
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from multiprocessing import get_context
from multiprocessing.connection import Connection
from typing import Any, Generic, Self, TypeVar

import numpy as np

from crane_bags.clocks import NANOSECONDS
from crane_identification.data.log import Log, Signal
from crane_identification.data.resample import sampling_rate
from crane_identification.online.estimator import Forces, OnlineEstimator, OnlineOptions
from crane_identification.signals.motion import reading_resolution
from crane_model.configuration import load
from crane_model.errors import CraneError, DataError
from crane_model.machine_files import machine_file
from crane_model.model_file import Model
from crane_model.progress_bar import Progress, silent
from crane_model.sensors import SensorChain

POLL_S = 0.2  # s between two looks at the progress of a background task

T = TypeVar("T")
MISSED_READINGS = 1.25  # intervals between readings that may pass before a new run begins
REPLAY_PARTS = 20  # of a recording, after each of which the estimate is read


class BackgroundTask(Generic[T]):
    """Runs `function(*arguments, progress=...)` in a process of its own, which ends with the
    context at the latest. Arguments, result and errors are sent, so they must be picklable.
    """

    def __init__(self, function: Callable[..., T], *arguments: object) -> None:
        context = get_context("spawn")  # a fork would leave the threads of libraries behind
        self._name = function.__name__
        self._share = context.Value("d", 0.0)
        self._receiver, sender = context.Pipe(duplex=False)
        self._process = context.Process(
            target=_work, args=(sender, self._share, function, arguments), daemon=True
        )
        self._process.start()
        sender.close()

    def result(self, progress: Progress) -> T:
        """Wait for the function's result; raises its `CraneError`, or one if the process dies."""
        while not self._receiver.poll(POLL_S):
            progress(self._name, self._share.value)
        try:
            result, error = self._receiver.recv()
        except EOFError:
            self._process.join()
            raise CraneError(
                f"{self._name}: its process ended with exit code {self._process.exitcode} and "
                f"without a result; if it was killed, memory may have run out"
            ) from None
        if error is not None:
            raise error
        progress(self._name, 1.0)
        return result

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._process.terminate()
        self._process.join()


def _work(
    sender: Connection, share: Any, function: Callable[..., object], arguments: tuple[Any, ...]
) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C ends the caller, and that this process

    def progress(phase: str, done: float) -> None:
        share.value = done

    try:
        sender.send((function(*arguments, progress=progress), None))
    except CraneError as error:
        sender.send((None, error))


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

    Raises `DataError` if the log lacks pressures and forces or has other joints than the model, and
    `ConfigurationError` as the estimator does.
    """
    estimator = _estimator(model, [log], options)
    forces: list[Forces] = []
    for done, part in enumerate(_feed(estimator, log), start=1):
        forces += part
        progress("recursion", done / REPLAY_PARTS)
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
    estimator = _estimator(model, logs, options)
    begin, time, solutions = 0.0, [], []
    for number, log in enumerate(logs):
        duration = float(log.position.time[-1])
        for done, _ in enumerate(_feed(estimator, log), start=1):
            time.append(begin + duration * done / REPLAY_PARTS)
            solutions.append(estimator.solve())
            progress("recursion", (number + done / REPLAY_PARTS) / len(logs))
        begin += duration
    return Recursive(
        model=estimator.fitted_model(),
        samples=estimator.samples,
        time=np.array(time),
        values=np.array([solution.values for solution in solutions]),
        std_devs=np.array([solution.std_devs for solution in solutions]),
    )


def _estimator(model: Model, logs: Sequence[Log], options: OnlineOptions | None) -> OnlineEstimator:
    """For readings of pressures, or of forces where all of `logs` hold them."""
    if options is None:
        sensors = load(machine_file("sensors.yaml"), SensorChain)
        if not set(model.joints) <= set(sensors.encoder_resolution):
            options = _fitting(logs)
    return OnlineEstimator(model, options, from_pressures=any(log.force is None for log in logs))


def _fitting(logs: Sequence[Log]) -> OnlineOptions:
    """For another machine than the default one: its encoders and rate as recorded."""
    resolution = np.max([reading_resolution(log.position.value) for log in logs], axis=0)
    interval = max(1.0 / sampling_rate(log.position.time) for log in logs)
    usual = OnlineOptions()
    slower = max(MISSED_READINGS * interval / usual.largest_gap, 1.0)
    return OnlineOptions(
        lag=slower * usual.lag,
        period=slower * usual.period,
        largest_gap=slower * usual.largest_gap,
        encoder_resolution=tuple(resolution.tolist()),
    )


def _feed(estimator: OnlineEstimator, log: Log) -> Iterator[list[Forces]]:
    """Every reading of `log` in the order of stamps; the forces that each part of it completes."""
    model = estimator.model
    if log.joints != model.joints:
        raise DataError(
            f"{log.source}: holds the joints {', '.join(log.joints)}, but the model has "
            f"{', '.join(model.joints)}; read the recording for the joints of the model"
        )
    driving, feed = _driving(estimator, log)
    encoder, stamps = _stamps(log, log.position.time), _stamps(log, driving.time)
    before = np.searchsorted(stamps, encoder, side="right")  # what came before
    fed = 0
    for part in np.array_split(np.arange(len(encoder)), REPLAY_PARTS):
        forces: list[Forces] = []
        for i in part:
            for k in range(fed, before[i]):
                forces += feed(int(stamps[k]), k)
            fed = before[i]
            forces += estimator.add_position(int(encoder[i]), log.position.value[i])
        if part[-1:] == len(encoder) - 1:
            for k in range(fed, len(stamps)):
                forces += feed(int(stamps[k]), k)
        yield forces


def _driving(
    estimator: OnlineEstimator, log: Log
) -> tuple[Signal, Callable[[int, int], list[Forces]]]:
    """Logged forces, as in the fit, else pressures; and the function that feeds sample k."""
    force, chamber_a, chamber_b = log.force, log.pressure_a, log.pressure_b
    if force is not None:
        return force, lambda stamp, k: estimator.add_force(stamp, force.value[k])
    if chamber_a is None or chamber_b is None:
        raise DataError(
            f"{log.source}: holds neither generalized forces nor chamber pressures; record "
            "/cylinder_pressures"
        )
    return chamber_a, lambda stamp, k: estimator.add_pressure(
        stamp, chamber_a.value[k], chamber_b.value[k]
    )


def _stamps(log: Log, time: np.ndarray) -> np.ndarray:
    """(n,) [ns] on the clock of the recording, exactly as they were recorded."""
    return log.start + np.round(time * NANOSECONDS).astype(np.int64)
