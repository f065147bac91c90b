"""What commands that read recordings share: their options, and the recordings that these mean."""

import argparse
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, fields
from itertools import combinations
from pathlib import Path

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


@dataclass(frozen=True)
class Sources:
    """Reads recordings of either kind, each file once: what `options` say is to be used of them."""

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
    """`DataError` naming the recordings given for training and for validation, and `why` not; or
    those that are given twice for one of them: they would count as two that agree.
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
    """`DataError` naming two recordings of the same samples: one is a copy of the other."""
    for one, other in combinations(logs, 2):
        if one.start == other.start and all(
            _same(getattr(one, field.name), getattr(other, field.name)) for field in fields(Log)
        ):
            raise DataError(
                f"{other.source}: the same samples as {one.source}, of which it is a copy; give "
                "each recording once"
            )


def _same(one: object, other: object) -> bool:
    """Whether two signals hold the same samples; what is no signal tells nothing."""
    if not isinstance(one, Signal) or not isinstance(other, Signal):
        return (one is None) == (other is None)
    return np.array_equal(one.time, other.time) and np.array_equal(
        one.value, other.value, equal_nan=True
    )


def add_recordings(
    parser: argparse.ArgumentParser, option: str, what: str, required: bool = False
) -> None:
    """Adds an option that names recordings; given several times, it names them all."""
    parser.add_argument(option, type=Path, nargs="+", default=[], required=required, help=what)


def add_part(parser: argparse.ArgumentParser) -> None:
    """Adds the options that say which part of a recording is used, and whose topics of a bag."""
    parser.add_argument(
        "--from",
        dest="begin",
        type=between(0.0),
        default=Options().begin,
        metavar="SECONDS",
        help="leave out what comes before, counted from the start of each recording",
    )
    parser.add_argument(
        "--to",
        dest="end",
        type=between(0.0),
        default=Options().end,
        metavar="SECONDS",
        help="leave out what comes behind, counted alike",
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
        help="of the crane, such as /left, where a bag holds several",
    )


def add_processing(parser: argparse.ArgumentParser) -> None:
    """Adds the options that say how recordings are used, of which `options_of` makes `Options`."""
    add_part(parser)
    parser.add_argument(
        "--period",
        type=above(0.0),
        metavar="SECONDS",
        help="period over which to average; found in the recordings where it is not given",
    )
    parser.add_argument(
        "--no-average",
        dest="average",
        action="store_false",
        help="use every sample: the motion is not periodic",
    )


def options_of(arguments: argparse.Namespace) -> Options:
    """What the options of `add_processing` choose."""
    return Options(
        begin=arguments.begin,
        end=arguments.end,
        namespace=arguments.namespace,
        rate=arguments.rate,
        average=arguments.average,
        period=arguments.period,
    )


def add_trust(parser: argparse.ArgumentParser) -> None:
    """Adds the option that goes on with recordings that look wrong."""
    parser.add_argument(
        "--trust-recordings",
        action="store_true",
        help="go on with recordings that look wrong (see check_recording); what is suspicious "
        "becomes a warning",
    )
