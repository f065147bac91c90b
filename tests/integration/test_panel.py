"""The operator's page in a real browser, and what visitors who should not be there get."""

import json
import re
import time
from collections.abc import Callable, Iterator
from typing import NamedTuple

import pytest
from integration.browser import installed
from integration.driver_stage import Stage
from integration.processes import RUN, end, start

from crane_interfaces.msg import DriverState

websockets = pytest.importorskip("websockets", reason="websockets is not installed (make view)")

from integration.live_page import Page  # noqa: E402
from websockets.sync.client import ClientConnection, connect  # noqa: E402

pytestmark = pytest.mark.realtime

PANEL = RUN.format(module="crane_driver.operator.panel.panel_node")
PATIENCE = 30.0  # s, bounds a failing test
DESK, PHONE = (1280, 900), (390, 844)
GARBAGE = [
    "no JSON", "[]", "3", "NaN", "[" * 900, "{}", '{"request": "move"}', '{"request": ["stop"]}',
    '{"token": 5}', b"\xff\x00", b'{"seen"',
]  # fmt: skip


class Served(NamedTuple):
    """A panel that runs."""

    url: str
    token: str

    @property
    def live(self) -> str:
        return self.url.replace("http", "ws", 1) + "/live"


@pytest.fixture(scope="module")
def panel(stage: Stage) -> Iterator[Served]:
    process = start(PANEL, "--ros-args", "-p", "port:=0")
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


def shows(page: Page, word: str) -> bool:
    return bool(page.evaluate("document.getElementById('word').textContent") == word)


def press(page: Page, button: str) -> None:
    page.evaluate(f"document.getElementById('{button}').click()")


def arm(page: Page, token: str) -> None:
    page.evaluate(f"document.getElementById('token').value = {json.dumps(token)}")
    press(page, "arm")


def visit(panel: Served, origin: str | None = None) -> ClientConnection:
    return connect(panel.live, origin=origin or panel.url, proxy=None)


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


@pytest.mark.parametrize("size", [DESK, PHONE], ids=["desk", "phone"])
def test_a_page_is_armed_by_the_token_enables_and_stops(
    stage: Stage, panel: Served, size: tuple[int, int]
) -> None:
    with Page(installed(), panel.url, *size) as page:
        until(lambda: shows(page, "disabled"))
        assert page.evaluate("document.getElementById('enable').disabled")
        assert page.evaluate("document.body.textContent.includes('Stop is no safety stop')")
        assert page.evaluate("document.documentElement.scrollWidth <= window.innerWidth")
        arm(page, panel.token)
        until(lambda: not page.evaluate("document.getElementById('enable').disabled"))
        press(page, "enable")
        until(lambda: shows(page, "enabled"))
        press(page, "stop")
        until(lambda: shows(page, "emergency stop"))
        press(page, "reset")
        until(lambda: shows(page, "disabled"))
        assert page.evaluate("document.querySelectorAll('#faults li').length") >= 1
    stage.until(lambda: not stage.valves[-1].enabled)


def test_a_page_shows_that_its_panel_is_gone(stage: Stage) -> None:
    process = start(PANEL, "--ros-args", "-p", "port:=0")
    try:
        assert process.stdout
        url = process.stdout.readline().split()[1]
        with Page(installed(), url, *PHONE) as page:
            until(lambda: shows(page, "disabled"))
            end(process)
            until(lambda: page.evaluate("document.body.classList.contains('lost')"))
            assert page.evaluate("document.getElementById('stop').disabled")
            assert page.evaluate("document.title") == "LOST"
    finally:
        end(process)


@pytest.mark.parametrize("origin", ["http://evil.example", "null", "http://127.0.0.1:1"])
def test_a_page_of_another_site_gets_no_line(panel: Served, origin: str) -> None:
    with pytest.raises(websockets.exceptions.InvalidStatus, match="403"):
        visit(panel, origin)


@pytest.mark.parametrize("garbage", GARBAGE, ids=repr)
def test_garbage_ends_the_page_and_not_the_panel(panel: Served, garbage: str | bytes) -> None:
    with visit(panel) as visitor:
        visitor.send(garbage)
        with pytest.raises(websockets.exceptions.ConnectionClosed):
            while True:
                visitor.recv(PATIENCE)
    with visit(panel) as visitor:
        assert heard(visitor, "picture")


@pytest.mark.parametrize("token", ["", "wrong", "\ud800", "ä" * 50])
def test_a_wrong_token_arms_nothing_and_holds_no_other_page_up(panel: Served, token: str) -> None:
    with visit(panel) as visitor, visit(panel) as other:
        visitor.send(json.dumps({"token": token}))
        refused = heard(visitor, "refusal")
        assert refused["armed"] is False
        assert "not the token" in str(refused["refusal"])
        visitor.send(json.dumps({"token": panel.token}))
        assert "wait a second" in str(heard(visitor, "refusal")["refusal"])
        other.send(json.dumps({"token": panel.token}))
        assert heard(other, "refusal")["armed"] is True
        visitor.send('{"request": "enable"}')
        assert "not armed" in str(heard(visitor, "answer")["message"])


def test_a_page_that_sleeps_is_lost_and_enables_nothing(stage: Stage, panel: Served) -> None:
    with visit(panel) as sleeper, visit(panel) as other:
        sleeper.send(json.dumps({"token": panel.token}))
        assert heard(sleeper, "refusal")["armed"] is True

        def lost() -> bool:
            picture = heard(other, "picture")["picture"]
            assert isinstance(picture, dict)
            return "an armed page" in str(picture["lost_page"])

        until(lost)
        with pytest.raises(websockets.exceptions.ConnectionClosed):
            for _ in range(1000):
                sleeper.send('{"request": "enable"}')
                sleeper.recv(PATIENCE)
        other.send('{"request": "enable"}')
        assert heard(other, "answer")["success"] is False
        assert heard(other, "picture")["picture"]["state"]["number"] == DriverState.STATE_DISABLED  # type: ignore[index]
