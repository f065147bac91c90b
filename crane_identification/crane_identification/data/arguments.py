"""Command-line options that the commands reading recordings share; light, for `--help`."""

import argparse
from dataclasses import fields
from pathlib import Path
from typing import Any, TypeVar

from crane_identification.options import Options
from crane_model.cli import above, between

Request = TypeVar("Request")


def request_of(kind: type[Request], arguments: argparse.Namespace) -> Request:
    """The dataclass `kind` with the parsed option of each field's name.

    A field `options` collects those of the parsed options that `Options` has.
    """
    given: dict[str, Any] = vars(arguments) | {"options": options_of(arguments)}
    return kind(**{field.name: given[field.name] for field in fields(kind)})  # type: ignore[arg-type]


def add_recordings(
    parser: argparse.ArgumentParser, option: str, what: str, required: bool = False
) -> None:
    """Add an option that names recordings; given several times, it names them all."""
    parser.add_argument(option, type=Path, nargs="+", default=[], required=required, help=what)


def add_part(parser: argparse.ArgumentParser) -> None:
    """Add the options that say what is read: columns, a part, a rate, a namespace."""
    parser.add_argument(
        "--columns", type=Path, help="column map (YAML) of tables, or of your topics"
    )
    parser.add_argument(
        "--from",
        dest="begin",
        type=between(0.0),
        default=Options().begin,
        metavar="SECONDS",
        help="start of the part to use [s], counted from the start of each recording (default: 0)",
    )
    parser.add_argument(
        "--to",
        dest="end",
        type=between(0.0),
        default=Options().end,
        metavar="SECONDS",
        help="end of the part to use [s], counted from the start of each recording "
        "(default: its end)",
    )
    parser.add_argument(
        "--rate",
        type=above(0.0),
        metavar="HZ",
        help="rate to which faster signals are reduced, behind an anti-aliasing filter"
        " [Hz] (default: as recorded)",
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
        help="period to average over [s] (default: found in the recordings)",
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
        help="continue with recordings that fail check_recording; its findings become warnings",
    )
