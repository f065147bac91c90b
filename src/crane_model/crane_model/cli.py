"""Common parts of all command lines: version, results, errors and interrupts, progress."""

import argparse
import math
import os
import sys
from collections.abc import Callable
from enum import StrEnum
from importlib.metadata import version
from pathlib import Path
from typing import Any, TypeVar

from crane_model.errors import ConfigurationError, CraneError
from crane_model.machine_files import DEFAULT_MACHINE

# Kinds of command line arguments: each says what it accepts, and what it got.

Choice = TypeVar("Choice", bound=StrEnum)


def above(low: float, high: float = math.inf) -> Callable[[str], float]:
    """A finite number above `low` and at most `high`."""
    limits = f"above {low:g}" + (f" and at most {high:g}" if high < math.inf else "")
    return _number(limits, lambda value: low < value <= high)


def between(low: float, high: float = math.inf) -> Callable[[str], float]:
    """A finite number, neither below `low` nor above `high`."""
    limits = f"from {low:g} to {high:g}" if high < math.inf else f"at least {low:g}"
    return _number(limits, lambda value: low <= value <= high)


def whole(low: int, high: int | None = None) -> Callable[[str], int]:
    """A whole number, neither below `low` nor above `high`."""
    limits = f"at least {low}" if high is None else f"from {low} to {high}"

    def read(text: str) -> int:
        try:
            value = int(text)
        except ValueError:
            raise _refused("a whole number", limits, text) from None
        if value < low or (high is not None and value > high):
            raise _refused("a whole number", limits, text)
        return value

    return read


def one_of(choices: type[Choice]) -> Callable[[str], Choice]:
    """A member by its value; others are answered with all there are."""

    def read(text: str) -> Choice:
        try:
            return choices(text)
        except ValueError:
            known = ", ".join(choices)
            raise argparse.ArgumentTypeError(f"there is no {text!r}; there are {known}") from None

    return read


def _number(limits: str, accepted: Callable[[float], bool]) -> Callable[[str], float]:
    def read(text: str) -> float:
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        if not (math.isfinite(value) and accepted(value)):
            raise _refused("a number", limits, text)
        return value

    return read


def _refused(kind: str, limits: str, text: str) -> argparse.ArgumentTypeError:
    return argparse.ArgumentTypeError(f"must be {kind} {limits}, got {text}")


EXTRAS = {"mujoco": "pictures", "polars": "tables", "rerun": "view"}
"""Large packages that few commands need, and the target of make that installs each."""
INTERRUPTED = 130  # the shell's convention: 128 + SIGINT


class _Store(argparse.Action):
    """As argparse stores; given again, an option of several values adds to those before."""

    def __call__(
        self,
        parser: argparse.ArgumentParser,
        namespace: argparse.Namespace,
        values: Any,
        option_string: str | None = None,
    ) -> None:
        before = getattr(namespace, self.dest)
        again = self.nargs == "+" and self.option_strings and before is not self.default
        setattr(namespace, self.dest, [*before, *values] if again else values)


def command_line(**options: Any) -> argparse.ArgumentParser:
    """A parser with --version, made with the `options` of an `ArgumentParser`.

    What an option of several values is given in one place adds to what it is given in another.
    """
    parser = argparse.ArgumentParser(**options)
    parser.register("action", None, _Store)
    told = f"%(prog)s of the crane suite {version('crane_model')}"
    parser.add_argument("--version", action="version", version=told)
    return parser


def add_machine(parser: argparse.ArgumentParser) -> None:
    """The option that names the machine; what is not named itself is a file of its folder."""
    parser.add_argument(
        "--machine",
        metavar="NAME",
        help="machine: name of a shipped machine, folder or machine file "
        f"(default: {DEFAULT_MACHINE})",
    )


def add_replace(parser: argparse.ArgumentParser) -> None:
    """The option that lets a command write over results; recordings are never written over."""
    parser.add_argument("--replace", action="store_true", help="overwrite existing files")


def check_out(*files: Path, replace: bool = False) -> None:
    """Raise `ConfigurationError` if one of `files` exists that is not to `replace`.

    Call it at the beginning of a command: an hour later is too late.
    """
    for file in files:
        if file.exists() and not (replace and file.is_file()):
            remedy = ", or --replace to write over it" if file.is_file() else ""
            raise ConfigurationError(f"{file}: exists; name another place{remedy}")
        there = next(parent for parent in file.absolute().parents if parent.exists())
        if not there.is_dir() or not os.access(there, os.W_OK):
            raise ConfigurationError(f"{file}: {there} cannot be written to; name another place")


def run(body: Callable[[], None]) -> int:
    """Run a command's body and turn what the suite raises into a message and an exit status."""
    try:
        body()
        sys.stdout.flush()
    except CraneError as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    except ModuleNotFoundError as error:
        if error.name not in EXTRAS:
            raise
        target = EXTRAS[error.name]
        print(
            f"error: {error.name} is not installed, because it is large and few commands need it; "
            f"install it by: make {target}",
            file=sys.stderr,
        )
        return 1
    except BrokenPipeError:  # the reader, say `head`, has seen enough; nothing is left to flush
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 1
    except KeyboardInterrupt:
        print("interrupted", file=sys.stderr)
        return INTERRUPTED
    return 0
