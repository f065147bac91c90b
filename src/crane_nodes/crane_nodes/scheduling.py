"""How the system shares the processor with the threads of a process."""

import os
from contextlib import suppress
from pathlib import Path


def schedule(process: int, policy: int, priority: int = 0) -> None:
    """Give all threads of a process, by its id, a policy; those they start later have it, too.

    Raises `PermissionError` where the system does not allow that.
    """
    for thread in Path(f"/proc/{process}/task").iterdir():
        with suppress(ProcessLookupError):  # it has ended meanwhile
            os.sched_setscheduler(int(thread.name), policy, os.sched_param(priority))


PATIENCE_S = 60.0
"""Real time for which simulated time waits for a process that is there but does not answer [s]."""
