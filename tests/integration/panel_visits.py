"""The operator's page served by a panel, and visitors that come by a line of their own."""

import json
import re
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import NamedTuple

import pytest
from integration.live_page import Page
from integration.processes import PATIENCE, RUN, end, start
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import ClientConnection, connect

PANEL = RUN.format(module="crane_driver.operator.panel.panel_node")
SILENT_AFTER = f"""
from crane_driver import constants
constants.PAGE_SILENCE_S = {{seconds}}
{PANEL}
"""
# Pages of a busy machine may be held up for seconds: the second is for tests of a page's silence.
PATIENT, LESS_PATIENT = (SILENT_AFTER.format(seconds=seconds) for seconds in (60.0, 12.0))
DESK, PHONE = (1280, 900), (390, 844)
SIZES = pytest.mark.parametrize("size", [DESK, PHONE], ids=["desk", "phone"])


class Served(NamedTuple):
    """A panel that runs."""

    url: str
    token: str

    @property
    def live(self) -> str:
        return self.url.replace("http", "ws", 1) + "/live"


@contextmanager
def served(*arguments: str, program: str = PANEL) -> Iterator[Served]:
    """A panel with these ROS arguments, which nothing ends but this."""
    process = start(program, "--ros-args", "-p", "port:=0", *arguments)
    try:
        assert process.stdout
        said = process.stdout.readline() + process.stdout.readline()
        found = re.search(r"page: +(\S+)\ntoken: +(\S+)", said)
        assert found, said
        yield Served(*found.groups())
        assert process.poll() is None, "something ended the panel"
    finally:
        assert end(process) == 0


def until(condition: Callable[[], object]) -> None:
    deadline = time.monotonic() + PATIENCE
    while not condition():
        assert time.monotonic() < deadline, "waited in vain"
        time.sleep(0.05)


def text(page: Page, element: str) -> str:
    return str(page.evaluate(f"document.getElementById('{element}').textContent"))


def shows(page: Page, word: str) -> bool:
    return text(page, "word") == word


def press(page: Page, button: str) -> None:
    page.evaluate(f"document.getElementById('{button}').click()")


def arm(page: Page, token: str) -> None:
    page.evaluate(f"document.getElementById('token').value = {json.dumps(token)}")
    press(page, "arm")


def visit(panel: Served, origin: str | None = None) -> ClientConnection:
    return connect(panel.live, origin=origin or panel.url, proxy=None, open_timeout=PATIENCE)


def heard(visitor: ClientConnection, key: str) -> dict[str, object]:
    """The next message of the panel that has `key`; every picture is answered."""
    deadline = time.monotonic() + PATIENCE
    while time.monotonic() < deadline:
        told: dict[str, object] = json.loads(visitor.recv(PATIENCE))
        if "picture" in told:
            visitor.send('{"seen": ""}')
        if key in told:
            return told
    raise AssertionError(f"no {key}")


def answer_pictures(visitor: ClientConnection) -> None:
    """Until its line is closed, as a page does."""

    def show() -> None:
        with suppress(ConnectionClosed):
            while True:
                heard(visitor, "picture")

    threading.Thread(target=show, daemon=True).start()
