"""Processes of the suite, started and stopped in order, none of them left behind."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from types import FrameType
from typing import Any, Self

from ament_index_python.packages import get_package_prefix

from crane_model.errors import CraneError

END_TIMEOUT_S = 20.0  # for a process to end by itself, once it was asked to
READY_TIMEOUT_S = 300.0  # in which nodes compile, where they run for the first time
LAST_LINES = 8  # of a log, in an error
SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


class ProcessError(CraneError):
    """A process ended, failed, or did not become ready in time."""


def command(package: str, executable: str, *arguments: object) -> list[str]:
    """Command that `ros2 run` would start."""
    path = Path(get_package_prefix(package)) / "lib" / package / executable
    return [str(path), *map(str, arguments)]


class Processes:
    """Processes that live within a `with` block; the last to start is the first to be stopped.

    Each is in a session of its own, so that Ctrl-C in the terminal reaches this program alone,
    which then asks them to end one by one. Their output goes to a log file each.
    """

    def __init__(self, logs: Path, environment: Mapping[str, str], simulated: bool):
        """`simulated`: whether the processes run on simulated time."""
        logs.mkdir(parents=True, exist_ok=True)
        self.simulated = simulated
        self.dbc: Path | None = None  # in the place of that of the machine
        self.clock = ("-p", "use_sim_time:=true") if simulated else ()
        self._logs = logs
        self._environment = os.environ | environment
        self._running: dict[str, subprocess.Popen[bytes]] = {}
        self._handlers: dict[signal.Signals, Any] = {}
        self._interrupted = False

    def __enter__(self) -> Self:
        for number in SIGNALS:
            self._handlers[number] = signal.signal(number, self._interrupt)
        return self

    def __exit__(self, kind: object, error: BaseException | None, trace: object) -> None:
        self.stop_all()
        for number, handler in self._handlers.items():
            signal.signal(number, handler)
        if self._interrupted and error is None:
            raise KeyboardInterrupt

    def _interrupt(self, _number: int, _frame: FrameType | None) -> None:
        """Only `check` acts on it, so that no process is lost on its way and none ends half."""
        self._interrupted = True

    def start(
        self,
        name: str,
        package: str,
        executable: str,
        *arguments: object,
        stdin: int = subprocess.DEVNULL,
    ) -> None:
        with self._log(name).open("ab") as log:
            self._running[name] = subprocess.Popen(
                command(package, executable, *arguments),
                stdin=stdin,
                stdout=log,
                stderr=subprocess.STDOUT,
                start_new_session=True,
                env=self._environment,
            )

    def attend(self, name: str, package: str, executable: str, *arguments: object) -> int:
        """Run one in the foreground, its output shown; its exit status."""
        process = subprocess.Popen(
            command(package, executable, *arguments),
            stdin=subprocess.DEVNULL,
            start_new_session=True,
            env=self._environment,
        )
        self._running[name] = process
        while process.poll() is None:
            self.check(name)
            time.sleep(0.1)
        del self._running[name]
        return process.returncode

    def tell(self, name: str, line: str) -> None:
        """Write a line to one that was started with a pipe."""
        pipe = self._running[name].stdin
        assert pipe is not None
        pipe.write(f"{line}\n".encode())
        pipe.flush()

    def output(self, name: str, package: str, executable: str, *arguments: object) -> str:
        """Run one to its end; what it printed."""
        self._log(name).unlink(missing_ok=True)
        self.start(name, package, executable, *arguments)
        self.finish(name)
        return self.said(name)

    def said(self, name: str) -> str:
        return self._log(name).read_text(encoding="utf-8")

    def finish(self, *names: str) -> None:
        """Wait until these have ended; `ProcessError` with the end of its log if one has failed."""
        left = list(names)
        while left:
            self.check(*left)
            for name in left:
                process = self._running[name]
                if process.poll() is not None:
                    left.remove(name)
                    if process.returncode:
                        raise self._ended(name)
                    del self._running[name]
                    break
            time.sleep(0.1)

    def check(self, *may_end: str) -> None:
        """`KeyboardInterrupt` after Ctrl-C; `ProcessError` if a process in the background ended."""
        if self._interrupted:
            raise KeyboardInterrupt
        for name, process in self._running.items():
            if process.poll() is not None and name not in may_end:
                raise self._ended(name)

    def _ended(self, name: str) -> ProcessError:
        return self.failed(f"{name} ended ({self._running[name].returncode})", name)

    def failed(self, what: str, name: str) -> ProcessError:
        """An error that shows the end of the log of a process which may know why."""
        log = self._log(name)
        lines = log.read_text(encoding="utf-8", errors="replace").splitlines()
        shown = "\n  ".join(lines[-LAST_LINES:])
        return ProcessError(f"{what}\n{log} ends with:\n  {shown}\nall logs: {self._logs}")

    def stop(self, name: str) -> None:
        """Ask one to end, and see to it."""
        process = self._running.pop(name)
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGKILL):
            if process.poll() is None:
                process.send_signal(number)
            try:
                process.wait(END_TIMEOUT_S)
                return
            except subprocess.TimeoutExpired:
                print(f"{name} does not end on {number.name}", file=sys.stderr)

    def stop_all(self) -> None:
        """Ask all to end, the last to start first."""
        for name in reversed(list(self._running)):
            self.stop(name)

    def until(self, condition: Callable[[], bool], otherwise: str | Callable[[], str]) -> None:
        """Wait for a condition; `ProcessError` if a process ends or it takes too long."""
        end = time.monotonic() + READY_TIMEOUT_S
        while not condition():
            self.check()
            if time.monotonic() > end:
                why = otherwise if isinstance(otherwise, str) else otherwise()
                raise self.failed(f"{why} (waited {READY_TIMEOUT_S:g} s)", "driver")

    def _log(self, name: str) -> Path:
        return self._logs / f"{name}.log"
