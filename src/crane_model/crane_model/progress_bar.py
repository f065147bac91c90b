"""Progress on standard error: a bar on a terminal, a line every ten seconds in a log."""

import sys
import time
from collections.abc import Callable, Iterable
from typing import Any, Self

from tqdm import tqdm

Progress = Callable[[str, float], None]
"""Called with the name of the phase and the share of it that is done, 0 to 1."""


def silent(phase: str, done: float) -> None:
    """Tell nobody."""


BAR_AFTER_S = 2.0  # before a bar appears
LINE_INTERVAL_S = 10.0
BAR_STEPS = 1000
BAR = " |{bar}|"
FORM = "{desc}: {percentage:3.0f} %" + BAR + " {elapsed} < {remaining}"


def progress_bar(
    description: str,
    total: float | None = None,
    over: Iterable[Any] | None = None,
    form: str = FORM,
    patience: float = BAR_AFTER_S,
) -> "tqdm[Any]":
    """A bar that `update` moves on towards `total`, or that goes with the items of `over`.

    It appears after `patience` [s] in tqdm's `form`, of which a line of a log lacks the bar.
    """
    if sys.stderr.isatty():
        return tqdm(over, description, total, bar_format=form, delay=patience)
    # Each update may become a line: nothing is to be drawn in time, the display sees to it.
    return _Lines(over, description, total, bar_format=form.replace(BAR, ""), miniters=0)


class _Lines(tqdm):  # type: ignore[type-arg]  # it takes none when it runs
    monitor_interval = 0  # no thread that refreshes
    told = time.monotonic()  # when the last line was written, of whatever bar

    def display(self, msg: str | None = None, pos: int | None = None) -> None:
        if self.n and time.monotonic() - _Lines.told >= LINE_INTERVAL_S:
            _Lines.told = time.monotonic()
            self.fp.write(f"{self}\n")
            self.fp.flush()

    def clear(self, nolock: bool = False) -> None:
        """Keep what was written."""

    def close(self) -> None:
        self.disable = True


class ProgressBar:
    """Progress of computations as bars on standard error, one bar for each phase.

    A `Progress` for `fit` and its like, and a context manager.
    """

    def __init__(self) -> None:
        self._phase = ""
        self._bar: tqdm[Any] | None = None

    def __call__(self, phase: str, done: float) -> None:
        """Show `phase` at the share `done`, 0 to 1."""
        if phase != self._phase or self._bar is None:
            self.close()
            self._phase = phase
            self._bar = progress_bar(phase, BAR_STEPS)
        self._bar.update(round(done * BAR_STEPS) - self._bar.n)

    def close(self) -> None:
        """End the bar that is shown."""
        if self._bar is not None:
            self._bar.close()
            self._bar = None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
