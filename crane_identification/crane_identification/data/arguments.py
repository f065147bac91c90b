"""Command-line options that the commands reading recordings share, and reading them."""

import argparse
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, fields
from itertools import combinations
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from crane_identification.data.bad_samples import usable
from crane_identification.data.column_map import ColumnMap
from crane_identification.data.log import Log, Signal
from crane_identification.data.recording_log import read_recording
from crane_identification.data.resample import slowed
from crane_identification.options import Options
from crane_model.cli import above, between
from crane_model.errors import DataError
from crane_model.model_file import Model
from crane_model.progress_bar import Progress

Request = TypeVar("Request")


def request_of(kind: type[Request], arguments: argparse.Namespace) -> Request:
    """The dataclass `kind` with the parsed option of each field's name.

    A field `options` collects those of the parsed options that `Options` has.
    """
    given: dict[str, Any] = vars(arguments) | {"options": options_of(arguments)}
    return kind(**{field.name: given[field.name] for field in fields(kind)})  # type: ignore[arg-type]


@dataclass(frozen=True)
class Sources:
    """Reads recordings of either kind, each file once, as far as the `options` use them."""

    model: Model
    columns: ColumnMap | None
    options: Options
    progress: Progress

    def read(self, paths: Sequence[Path]) -> tuple[Log, ...]:
        """A log of each bag or table; `DataError` and `ConfigurationError` as their readers."""
        joints, options = self.model.joints, self.options
        logs = (
            read_recording(path, joints, self.columns, self.progress, options.namespace)
            for path in paths
        )
        return tuple(slowed(usable(log, options.begin, options.end), options.rate) for log in logs)


def refuse_overlap(train: Sequence[Path], validate: Sequence[Path], why: str) -> None:
    """`DataError` if a recording is given for training and validation, with the reason `why` not,
    or twice for one of them: it would count as two that agree.
    """
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


def add_recordings(
    parser: argparse.ArgumentParser, option: str, what: str, required: bool = False
) -> None:
    """Add an option that names recordings; given several times, it names them all."""
    parser.add_argument(option, type=Path, nargs="+", default=[], required=required, help=what)


def add_part(parser: argparse.ArgumentParser) -> None:
    """Add the options that choose a part of each recording, and the namespace of a bag."""
    parser.add_argument(
        "--from",
        dest="begin",
        type=between(0.0),
        default=Options().begin,
        metavar="SECONDS",
        help="begin of the part to use, from the start of each recording",
    )
    parser.add_argument(
        "--to",
        dest="end",
        type=between(0.0),
        default=Options().end,
        metavar="SECONDS",
        help="end of the part to use, from the start of each recording",
    )
    parser.add_argument(
        "--rate",
        type=above(0.0),
        metavar="HZ",
        help="rate to which faster signals are slowed down, behind a low-pass against aliases "
        "(default: as recorded)",
    )
    parser.add_argument(
        "--namespace",
        type=lambda text: "/" + text.strip("/"),
        help="ROS namespace of the crane, for example /left, if a bag holds several",
    )


def add_processing(parser: argparse.ArgumentParser) -> None:
    """Add the options that say how recordings are used; `options_of` reads them."""
    add_part(parser)
    parser.add_argument(
        "--period",
        type=above(0.0),
        metavar="SECONDS",
        help="period over which to average (default: found in the recordings)",
    )
    parser.add_argument(
        "--no-average",
        dest="average",
        action="store_false",
        help="use every sample: the motion is not periodic",
    )


def options_of(arguments: argparse.Namespace) -> Options:
    """The parsed options that `Options` has a field for."""
    given = vars(arguments)
    return Options(
        **{field.name: given[field.name] for field in fields(Options) if field.name in given}
    )


def add_trust(parser: argparse.ArgumentParser) -> None:
    """Add the option that goes on with recordings that look wrong."""
    parser.add_argument(
        "--trust-recordings",
        action="store_true",
        help="go on with recordings that look wrong (see check_recording); what is suspicious "
        "becomes a warning",
    )
