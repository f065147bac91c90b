"""Polarity of a valve: which way a joint moves at the smallest opening that moves it."""

from typing import Literal

from crane_model.errors import DataError
from crane_model.result_file import ResultPart


class Nudge(ResultPart):
    """The first movement of a joint under a command that rose slowly from 0."""

    command: float
    """At which the movement was seen, -1 to 1 [-]."""
    moved: float
    """Way until it was seen [rad, m]."""
    way: float
    """Way until the joint stood again [rad, m]."""


class PolarityResult(ResultPart):
    """Of a valve."""

    polarity: Literal[-1, 1]
    """What the sign of its command has to be multiplied by [-]."""
    up: Nudge
    """By a positive command."""
    down: Nudge
    """By a negative command."""


def find_polarity(joint: str, up: Nudge, down: Nudge) -> PolarityResult:
    """`DataError` if both commands moved the joint in the same direction."""
    if up.moved * down.moved >= 0.0:
        raise DataError(
            f"{joint}: moved by {up.moved:+.3g} at the command {up.command:+.3f} and by "
            f"{down.moved:+.3g} at {down.command:+.3f}, both in one direction; it sinks by itself, "
            "or one side of its valve does not work"
        )
    return PolarityResult(polarity=1 if up.moved > 0.0 else -1, up=up, down=down)
