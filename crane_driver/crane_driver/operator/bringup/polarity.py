"""Polarity of a valve: which way a joint moves at the smallest opening that moves it."""

from dataclasses import dataclass
from typing import Literal

from crane_model.errors import DataError


@dataclass(frozen=True)
class Nudge:
    """The first movement of a joint under a command that rose slowly from 0."""

    command: float  # -1..1, at which the movement was seen
    moved: float  # rad, m, until it was seen
    way: float  # rad, m, until the joint stood again


@dataclass(frozen=True)
class PolarityResult:
    """What the sign of the command has to be multiplied by, and both nudges."""

    polarity: Literal[-1, 1]
    up: Nudge  # by a positive command
    down: Nudge


def find_polarity(joint: str, up: Nudge, down: Nudge) -> PolarityResult:
    """`DataError` if both commands moved the joint in the same direction."""
    if up.moved * down.moved >= 0.0:
        raise DataError(
            f"{joint}: moved by {up.moved:+.3g} at the command {up.command:+.3f} and by "
            f"{down.moved:+.3g} at {down.command:+.3f}, both in one direction; it sinks by itself, "
            "or one side of its valve does not work"
        )
    return PolarityResult(1 if up.moved > 0.0 else -1, up, down)
