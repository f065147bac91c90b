"""How long computations tell their caller where they are, without printing."""

from collections.abc import Callable

Progress = Callable[[str, float], None]
"""Called with the name of the phase and the share of it that is done, 0 to 1."""


def silent(phase: str, done: float) -> None:
    """Tell nobody."""
