"""A line every half minute where the output of a parallel run goes to a log."""

from threading import Event, Thread
from time import monotonic

import pytest

PERIOD = 30.0  # s


class Heartbeat:
    """Tell how many tests are done, how many of them failed, and which files are at work."""

    def __init__(self) -> None:
        self.begin = monotonic()
        self.running: set[str] = set()  # node ids
        self.done = self.failed = 0
        self.end = Event()

    def line(self, total: int) -> str:
        minutes, seconds = divmod(round(monotonic() - self.begin), 60)
        files = sorted({one.partition("::")[0].rpartition("/")[2] for one in self.running})
        return (
            f"{minutes}:{seconds:02d} min: {self.done} of {total} tests done, "
            f"{self.failed} failed; now {', '.join(files) or 'the workers start'}"
        )

    def beat(self, session: pytest.Session) -> None:
        terminal = session.config.pluginmanager.get_plugin("terminalreporter")
        while not self.end.wait(PERIOD):
            terminal.write(f"\n{self.line(session.testscollected)}\n", flush=True)

    def pytest_sessionstart(self, session: pytest.Session) -> None:
        Thread(target=self.beat, args=[session], daemon=True).start()

    def pytest_runtest_logstart(self, nodeid: str) -> None:
        self.running.add(nodeid)

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        self.failed += report.failed
        if report.when == "teardown":
            self.done += 1
            self.running.discard(report.nodeid)

    def pytest_sessionfinish(self) -> None:
        self.end.set()
