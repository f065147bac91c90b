"""The operator's page in a real browser, and what visitors who should not be there get."""

import json
import re
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, closing, contextmanager, suppress
from pathlib import Path
from typing import NamedTuple

import pytest
from integration.browser import installed
from integration.driver_stage import Stage
from integration.processes import RUN, end, start

from crane_driver.operator.panel.pages import LONGEST_REASON, MOST_PAGES
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


@contextmanager
def served(*arguments: str) -> Iterator[Served]:
    """A panel with these ROS arguments, which nothing ends but this."""
    process = start(PANEL, "--ros-args", "-p", "port:=0", *arguments)
    try:
        assert process.stdout
        said = process.stdout.readline() + process.stdout.readline()
        found = re.search(r"page: +(\S+)\ntoken: +(\S+)", said)
        assert found, said
        yield Served(*found.groups())
        assert process.poll() is None, "something ended the panel"
    finally:
        assert end(process) == 0


@pytest.fixture(scope="module")
def panel(stage: Stage) -> Iterator[Served]:
    with served() as one:
        yield one


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


def lost_page(visitor: ClientConnection) -> str:
    picture = heard(visitor, "picture")["picture"]
    assert isinstance(picture, dict)
    return str(picture["lost_page"])


def answer_pictures(visitor: ClientConnection) -> None:
    """Until its line is closed, as a page does."""

    def show() -> None:
        with suppress(websockets.exceptions.ConnectionClosed):
            while True:
                heard(visitor, "picture")

    threading.Thread(target=show, daemon=True).start()


SIZES = pytest.mark.parametrize("size", [DESK, PHONE], ids=["desk", "phone"])


@SIZES
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


@SIZES
def test_stop_acts_when_it_is_pressed_wherever_the_page_is_scrolled_to(
    stage: Stage, panel: Served, size: tuple[int, int]
) -> None:
    stage.enabled()
    with Page(installed(), panel.url, *size) as page:
        until(lambda: shows(page, "enabled"))
        page.evaluate("window.scrollTo(0, document.body.scrollHeight)")
        page.press("stop")  # and is not let go
        until(lambda: shows(page, "emergency stop"))
    stage.until(lambda: not stage.valves[-1].enabled)
    stage.disabled()


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
            why = "document.getElementById('loss').textContent.includes('the panel was ended')"
            assert page.evaluate(why)
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

        until(lambda: "an armed page" in lost_page(other))
        with pytest.raises(websockets.exceptions.ConnectionClosed):
            for _ in range(1000):
                sleeper.send('{"request": "enable"}')
                sleeper.recv(PATIENCE)
        other.send('{"request": "enable"}')
        assert heard(other, "answer")["success"] is False
        assert heard(other, "picture")["picture"]["state"]["number"] == DriverState.STATE_DISABLED  # type: ignore[index]


@pytest.mark.parametrize(
    "reason", ["all is well\u202e\r\n\x1b[31m", "<script>alert(1)</script>", "\U0010ffff" * 30]
)
def test_a_reason_that_a_page_gives_is_shown_to_others_as_its_words(
    panel: Served, reason: str
) -> None:
    with visit(panel) as other:
        with visit(panel) as visitor:
            visitor.close(4000, reason)
        until(lambda: lost_page(other))
        shown = lost_page(other)
        assert f'it said "{reason[:7].replace(chr(0x10FFFF), "?")}' in shown
        assert re.fullmatch("[ -~]*", shown)
        assert len(shown) < LONGEST_REASON + 60  # with its address, and when it was lost


def test_a_reason_that_is_no_text_ends_that_page_alone(panel: Served) -> None:
    with visit(panel) as other, visit(panel) as visitor:
        visitor.socket.sendall(b"\x88\x84\0\0\0\0\x0f\xa0\xff\xfe")  # close, 4000, not UTF-8
        until(lambda: lost_page(other))


def test_pages_beyond_the_limit_are_refused_until_another_one_is_closed(panel: Served) -> None:
    with ExitStack() as stack:
        pages = []
        with pytest.raises(websockets.exceptions.ConnectionClosed) as refused:
            for _ in range(MOST_PAGES + 1):
                visitor = stack.enter_context(visit(panel))
                heard(visitor, "picture")
                answer_pictures(visitor)
                pages.append(visitor)
        assert refused.value.rcvd
        assert refused.value.rcvd.code == 1013
        assert f"limit {MOST_PAGES}" in refused.value.rcvd.reason
        pages[0].close()

        def opens() -> bool:
            with suppress(websockets.exceptions.ConnectionClosed), visit(panel) as visitor:
                return bool(heard(visitor, "picture"))
            return False

        until(opens)


def test_a_panel_in_a_namespace_shows_and_stops_the_crane_there_alone(
    stage: Stage, tmp_path: Path
) -> None:
    with closing(Stage(tmp_path, [], namespace="left")) as left, served(*left.remapping) as one:

        def shown() -> bool:
            left.enabled()
            with visit(one) as visitor:
                picture = heard(visitor, "picture")["picture"]
                assert isinstance(picture, dict)
                return (picture["namespace"], picture["state"]["word"]) == ("/left", "enabled")

        until(shown)
        with visit(one) as visitor:
            visitor.send('{"request": "stop"}')
            left.until(lambda: left.safety[0] == "emergency stop")
            assert stage.report()[0] != "emergency stop"
