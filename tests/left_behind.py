"""Kill the processes that a killed test run leaves behind: their environment holds its mark."""

import os
import signal
import subprocess
import sys
import time
import uuid
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

MARK = "CRANE_TEST_RUN"
PERIOD = 0.5  # s, between two looks


def alive_with(mark: bytes) -> list[tuple[int, str]]:
    """Processes, by id and command line, that inherited the mark and have not ended."""
    found = []
    for folder in Path("/proc").iterdir():
        with suppress(OSError):  # no process, of another user, or gone meanwhile
            if mark in (folder / "environ").read_bytes().split(b"\0"):
                found.append((int(folder.name), (folder / "cmdline").read_text()))
    return found


@contextmanager
def none_left_behind() -> Iterator[bytes]:
    """Mark all processes that are started meanwhile; if this one is killed, they are, too."""
    value = uuid.uuid4().hex
    mark = f"{MARK}={value}"
    watcher = subprocess.Popen(
        [sys.executable, "-I", __file__, str(os.getpid()), mark],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        start_new_session=True,  # Ctrl-C is not for it
    )
    os.environ[MARK] = value
    try:
        yield mark.encode()
    finally:
        del os.environ[MARK]
        watcher.kill()
        watcher.wait()


def watch(parent: int, mark: bytes) -> None:
    """Wait for the end of the parent, and kill all that it marked."""
    while os.getppid() == parent:
        time.sleep(PERIOD)
    for number, _ in alive_with(mark):
        with suppress(ProcessLookupError):
            os.kill(number, signal.SIGKILL)


if __name__ == "__main__":
    watch(int(sys.argv[1]), sys.argv[2].encode())
