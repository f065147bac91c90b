"""Kinds of command line arguments: each says what it accepts, and what it got."""

import argparse
import math
from collections.abc import Callable
from enum import StrEnum
from typing import TypeVar

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
