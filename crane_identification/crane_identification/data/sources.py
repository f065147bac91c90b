"""Reading the recordings that a command is given, each once."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from itertools import combinations
from pathlib import Path

import numpy as np

from crane_identification.data.bad_samples import usable
from crane_identification.data.column_map import ColumnMap
from crane_identification.data.log import Log, Signal
from crane_identification.data.recording_log import read_recording
from crane_identification.data.resample import slowed
from crane_identification.options import Options
from crane_model.errors import DataError
from crane_model.model_file import Model
from crane_model.progress_bar import Progress


@dataclass(frozen=True)
class Sources:
    """Reads recordings of either kind, each file once, as far as the `options` use them."""

    model: Model
    columns: ColumnMap | None
    options: Options
    progress: Progress

    def read(self, paths: Sequence[Path]) -> tuple[Log, ...]:
        """A log of each bag or table; `DataError` and `ConfigurationError` as their readers."""
        joints, options, machine = self.model.joints, self.options, self.model.machine

        def log_of(path: Path) -> Log:
            log = read_recording(path, joints, self.columns, self.progress, options.namespace)
            if machine is not None:
                log = late(log, machine.latency(joints))
            return slowed(usable(log, options.begin, options.end), options.rate)

        return tuple(log_of(path) for path in paths)


def late(log: Log, latency: np.ndarray) -> Log:
    """`log` with positions, and velocities, that are older than their stamps by (j,) [s]."""
    velocity = log.velocity and replace(log.velocity, latency=latency)
    return replace(log, position=replace(log.position, latency=latency), velocity=velocity)


def refuse_overlap(train: Sequence[Path], validate: Sequence[Path], why: str) -> None:
    """`DataError` if a recording is given twice, or for both purposes, with the reason `why`."""
    both = {path.resolve() for path in train} & {path.resolve() for path in validate}
    if both:
        raise DataError(
            f"{', '.join(map(str, sorted(both)))}: given for training and for validation; {why}"
        )
    for paths in (train, validate):
        times = Counter(path.resolve() for path in paths)
        if twice := [str(path) for path, count in times.items() if count > 1]:
            raise DataError(f"{', '.join(sorted(twice))}: given twice; give each recording once")


def refuse_copies(logs: Sequence[Log]) -> None:
    """`DataError` if two recordings hold the same samples."""
    for log, later in combinations(logs, 2):
        if log.start == later.start and all(
            _same(getattr(log, field.name), getattr(later, field.name)) for field in fields(Log)
        ):
            raise DataError(
                f"{later.source}: the same samples as {log.source}, of which it is a copy; give "
                "each recording once"
            )


def _same(first: object, second: object) -> bool:
    """Return whether two signals hold the same samples, or neither is a signal."""
    if not isinstance(first, Signal) or not isinstance(second, Signal):
        return (first is None) == (second is None)
    return np.array_equal(first.time, second.time) and np.array_equal(
        first.value, second.value, equal_nan=True
    )
