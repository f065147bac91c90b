"""Work that may take long, beside what must be on time."""

import os

REAL_TIME = (os.SCHED_FIFO, os.SCHED_RR)


def give_way() -> None:
    """From now on this thread, and what it starts, has no real-time priority.

    Work of a second under SCHED_FIFO has a core for itself, and the kernel then stops all that has
    that priority there for 50 ms of every second: the driver, too.
    """
    if os.sched_getscheduler(0) in REAL_TIME:
        os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
