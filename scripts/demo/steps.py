"""The steps of the demo: each is told as it begins, with the time that it usually takes."""

import time
from collections.abc import Iterator
from contextlib import contextmanager
from statistics import median
from timeit import repeat

from rich.console import Console

LOOP_MS = 28.0  # of the computer on which the usual times were measured, by `measured_loop`


def measured_loop() -> float:
    """Time that this computer takes for a million multiplications in Python [ms]."""
    loop = "for i in range(1000000): i * i"
    return 1e3 * median(repeat(loop, number=1, repeat=5))


class Steps:
    """Tells the steps on a terminal and in a log alike, and takes the time of each."""

    def __init__(self, console: Console, count: int):
        self.console = console
        self.seconds: dict[str, float] = {}
        self._count = count
        self._slowness = measured_loop() / LOOP_MS

    @contextmanager
    def step(self, name: str, what: str, usual: float) -> Iterator[None]:
        """Tell and time one; `usual` [s] is what it takes where the loop takes `LOOP_MS`."""
        number = len(self.seconds) + 1
        about = shown(usual * self._slowness)
        self.console.print(f"[{number}/{self._count}] {what} (about {about})", markup=False)
        start = time.monotonic()
        yield
        self.seconds[name] = round(time.monotonic() - start, 2)


def shown(seconds: float) -> str:
    """A time as people say it: to 5 s, from 90 s on to half a minute."""
    if seconds < 90.0:
        return f"{max(5, 5 * round(seconds / 5))} s"
    return f"{round(seconds / 30) / 2:g} min"
