"""Pages beyond the limit of live ones, and stop without a live line."""

import http.client
import json
from collections.abc import Iterator
from contextlib import ExitStack, closing, suppress
from urllib.parse import urlsplit

import pytest
from integration.browser import installed
from integration.driver_stage import Stage

from crane_driver import constants

websockets = pytest.importorskip("websockets", reason="websockets is not installed (make view)")

from integration.live_page import Page  # noqa: E402
from integration.panel_visits import (  # noqa: E402
    PATIENCE,
    PATIENT,
    SIZES,
    Served,
    answer_pictures,
    heard,
    served,
    shows,
    text,
    until,
    visit,
)
from websockets.sync.client import ClientConnection  # noqa: E402


@pytest.fixture(scope="module")
def stage(ros_domain: int, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Stage]:
    """A crane that goes on while a test waits for a page."""
    one = Stage(tmp_path_factory.mktemp("stage"), [], awaited=False)
    yield one
    one.close()


@pytest.fixture(scope="module")
def panel(stage: Stage) -> Iterator[Served]:
    with served(program=PATIENT) as one:
        yield one


def posted(panel: Served, headers: dict[str, str], body: str = "") -> tuple[int, str]:
    """The status and the answer of a POST to /stop."""
    with closing(http.client.HTTPConnection(urlsplit(panel.url).netloc, timeout=PATIENCE)) as line:
        line.request("POST", "/stop", body, headers)
        answer = line.getresponse()
        return answer.status, answer.read().decode()


def stopped(stage: Stage) -> bool:
    """By emergency stop, whatever faults a busy machine adds."""
    return stage.safety[0].startswith("emergency stop")


@pytest.fixture
def full(panel: Served) -> Iterator[list[ClientConnection]]:
    """As many live pages as there may be."""
    with ExitStack() as stack:
        pages: list[ClientConnection] = []

        def filled() -> bool:
            """Until those of the test before have all ended."""
            try:
                while len(pages) < constants.MOST_PAGES:
                    visitor = stack.enter_context(visit(panel))
                    heard(visitor, "picture")
                    answer_pictures(visitor)
                    pages.append(visitor)
            except websockets.exceptions.ConnectionClosed:
                return False
            return True

        until(filled)
        yield pages


def test_pages_beyond_the_limit_are_refused_until_another_one_is_closed(
    panel: Served, full: list[ClientConnection]
) -> None:
    with visit(panel) as visitor, pytest.raises(websockets.exceptions.ConnectionClosed) as refused:
        heard(visitor, "picture")
    assert refused.value.rcvd
    assert refused.value.rcvd.code == 1013
    assert f"limit {constants.MOST_PAGES}" in refused.value.rcvd.reason
    full[0].close()

    def opens() -> bool:
        with suppress(websockets.exceptions.ConnectionClosed), visit(panel) as visitor:
            return bool(heard(visitor, "picture"))
        return False

    until(opens)


@SIZES
def test_a_page_beyond_the_limit_can_stop_the_crane(
    stage: Stage, panel: Served, full: list[ClientConnection], size: tuple[int, int]
) -> None:
    stage.enabled()
    with Page(installed(), panel.url, *size) as page:
        until(lambda: "Stop works from here" in text(page, "loss"))
        assert f"limit {constants.MOST_PAGES}" in text(page, "loss")
        assert page.evaluate("document.getElementById('enable').disabled")
        assert page.evaluate("document.getElementById('arm').disabled")
        assert page.press("stop")
        stage.until(lambda: stopped(stage))
        until(lambda: text(page, "answer") == "stop: emergency stop")
        full[0].close()
        until(lambda: shows(page, "emergency stop"))
        assert page.evaluate("!document.body.classList.contains('lost')")
    stage.disabled()


@pytest.mark.parametrize(
    ("headers", "body", "status"),
    [
        ({"Origin": "http://evil.example"}, "", 403),
        ({"Origin": "null"}, "", 403),
        ({}, "", 403),
        ({"Host": "evil.example", "Origin": "http://evil.example"}, "", 403),
        ({"Origin": "{own}"}, " " * (constants.LARGEST_MESSAGE_BYTES + 1), 400),
    ],
    ids=["another", "null", "none", "host", "long"],
)
def test_a_stop_that_no_page_of_the_panel_asks_for_is_refused(
    stage: Stage, panel: Served, headers: dict[str, str], body: str, status: int
) -> None:
    stage.disabled()
    given = {name: value.format(own=panel.url) for name, value in headers.items()}
    assert posted(panel, given, body)[0] == status
    stage.report()
    assert not stopped(stage)


def test_a_stop_without_a_line_answers_what_the_driver_did(stage: Stage, panel: Served) -> None:
    stage.disabled()
    status, said = posted(panel, {"Origin": panel.url}, " " * constants.LARGEST_MESSAGE_BYTES)
    assert status == 200
    assert json.loads(said) == {"answer": "stop", "success": True, "message": "emergency stop"}
    stage.until(lambda: stopped(stage))
    stage.disabled()


def test_a_stop_without_a_line_says_that_no_driver_was_heard() -> None:
    with served("-r", "__ns:=/nobody") as lonely:
        status, said = posted(lonely, {"Origin": lonely.url})
        assert status == 200
        answer = json.loads(said)
        assert answer["success"] is False
        assert "no driver publishes its state on /nobody/driver/state" in answer["message"]
