"""A test run that is killed leaves no process behind."""

import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import left_behind

RUN = """
import subprocess, time
from left_behind import none_left_behind
with none_left_behind() as mark:
    subprocess.Popen(["sh", "-c", "sleep 600 & sleep 600"], start_new_session=True)
    print(mark.decode(), flush=True)
    time.sleep(600)
"""


def test_processes_of_a_killed_run_end() -> None:
    run = subprocess.Popen(
        [sys.executable, "-c", RUN],
        stdout=subprocess.PIPE,
        text=True,
        cwd=Path(left_behind.__file__).parent,
    )
    assert run.stdout is not None
    mark = run.stdout.readline().strip().encode()
    wait_until(lambda: left_behind.alive_with(mark))  # a process that starts has no mark yet
    run.kill()
    run.communicate()
    wait_until(lambda: not left_behind.alive_with(mark))


def wait_until(condition: Callable[[], object]) -> None:
    until = time.monotonic() + 60.0
    while not condition():
        assert time.monotonic() < until
        time.sleep(0.1)
