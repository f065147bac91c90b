"""How fast this computer runs Python, so that targets for processor time fit any computer."""

import resource
import time
from functools import cache
from statistics import median
from timeit import repeat

LOOP, ROUNDS = "for i in range(1000000): i * i", 9
REFERENCE = 0.028  # s of this loop on the computer that targets are stated for


@cache
def loop_time() -> float:
    """Median processor time [s] of a loop of a million multiplications: the measured loop."""
    return median(repeat(LOOP, timer=time.thread_time, number=1, repeat=ROUNDS))


def scaled(target: float) -> float:
    """A target for processor time, stated where the measured loop takes `REFERENCE`, for here."""
    return target * loop_time() / REFERENCE


def of_children() -> float:
    """CPU time [s] of all processes that were started and have ended."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime
