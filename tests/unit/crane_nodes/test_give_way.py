"""What takes long has no real-time priority, whoever began it."""

import os
import subprocess
import sys
from threading import Thread

import pytest

from crane_nodes.this_computer import give_way

POLICY = "import os; print(os.sched_getscheduler(0))"


@pytest.mark.parametrize("policy", [os.SCHED_FIFO, os.SCHED_RR])
def test_it_gives_way_with_the_processes_that_it_starts_and_nobody_else_does(policy: int) -> None:
    told: dict[str, int] = {}

    def work() -> None:
        give_way()
        told["thread"] = os.sched_getscheduler(0)
        started = subprocess.run([sys.executable, "-c", POLICY], capture_output=True, text=True)
        told["process"] = int(started.stdout)

    def begin() -> None:
        try:
            os.sched_setscheduler(0, policy, os.sched_param(1))
        except PermissionError:
            return
        (thread := Thread(target=work)).start()
        thread.join()
        told["before"] = os.sched_getscheduler(0)

    (beginner := Thread(target=begin)).start()
    beginner.join()
    if not told:
        pytest.skip("real-time priority is not permitted here")
    assert told == {"thread": os.SCHED_OTHER, "process": os.SCHED_OTHER, "before": policy}


def test_another_policy_stays() -> None:
    before = os.sched_getscheduler(0), os.sched_getparam(0).sched_priority
    give_way()
    assert (os.sched_getscheduler(0), os.sched_getparam(0).sched_priority) == before
