"""The operator's page in a real browser, and what visitors who should not be there get."""

import json
import re
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import pytest
from integration.browser import installed
from integration.driver_stage import Stage
from integration.processes import end, start

from crane_driver import constants

websockets = pytest.importorskip("websockets", reason="websockets is not installed (make view)")

from integration.live_page import Page  # noqa: E402
from integration.panel_visits import (  # noqa: E402
    LESS_PATIENT,
    PANEL,
    PATIENCE,
    PATIENT,
    PHONE,
    SIZES,
    Served,
    arm,
    heard,
    press,
    served,
    shows,
    text,
    until,
    visit,
)
from websockets.sync.client import ClientConnection  # noqa: E402

GARBAGE = [
    "no JSON", "[]", "3", "NaN", "[" * 900, "{}", '{"request": "move"}', '{"request": ["stop"]}',
    '{"token": 5}', b"\xff\x00", b'{"seen"',
]  # fmt: skip


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


def lost_page(visitor: ClientConnection) -> str:
    picture = heard(visitor, "picture")["picture"]
    assert isinstance(picture, dict)
    return str(picture["lost_page"])


def disabled(page: Page, button: str) -> bool:
    return bool(page.evaluate(f"document.getElementById('{button}').disabled"))


def armed(page: Page, token: str) -> bool:
    """Whether it is; else it is armed now, as one that a busy machine has lost."""
    if disabled(page, "enable"):
        arm(page, token)
    return not disabled(page, "enable")


def brought(page: Page, token: str, word: str, buttons: dict[str, str]) -> bool:
    """Whether the crane has come to a state, `buttons` being pressed in others. A busy machine adds
    faults, and loses pages, which are armed anew.
    """
    armed(page, token)
    for other, button in buttons.items():
        if shows(page, other):
            press(page, button)
    return shows(page, word)


@SIZES
def test_a_page_is_armed_by_the_token_enables_and_stops(
    stage: Stage, panel: Served, size: tuple[int, int]
) -> None:
    with Page(installed(), panel.url, *size) as page:
        until(lambda: shows(page, "disabled"))
        assert disabled(page, "enable")
        assert page.evaluate("document.body.textContent.includes('Stop is not a safety stop')")
        assert page.evaluate("document.documentElement.scrollWidth <= window.innerWidth")
        until(lambda: armed(page, panel.token))
        enable = {"disabled": "enable", "fault": "reset"}
        stop = dict.fromkeys(("enabled", "disabled", "fault"), "stop")
        reset = dict.fromkeys(("emergency stop", "fault"), "reset")
        until(lambda: brought(page, panel.token, "enabled", enable))
        until(lambda: brought(page, panel.token, "emergency stop", stop))
        assert text(page, "remedy") == "make sure that the crane may move, then press Reset"
        until(lambda: brought(page, panel.token, "disabled", reset))
        assert page.evaluate("document.querySelectorAll('#faults li').length") >= 1
    stage.until(lambda: not stage.valves[-1].enabled)


@SIZES
def test_stop_acts_when_it_is_pressed_wherever_the_page_is_scrolled_to(
    stage: Stage, panel: Served, size: tuple[int, int]
) -> None:
    stage.enabled()
    with Page(installed(), panel.url, *size) as page:

        def stops() -> bool:
            """Unless a busy machine has not loaded the page yet, or loses it before."""
            if disabled(page, "stop"):
                return False
            page.evaluate("window.scrollTo(0, document.body.scrollHeight)")
            pressed = page.press("stop")  # and is not let go
            return pressed and stage.within(lambda: stage.safety[0].startswith("emergency stop"))

        until(stops)
        until(lambda: shows(page, "emergency stop"))
    stage.until(lambda: not stage.valves[-1].enabled)
    stage.disabled()


def test_a_page_shows_that_its_panel_is_gone(stage: Stage) -> None:
    stage.disabled()
    process = start(PANEL, "--ros-args", "-p", "port:=0")
    try:
        assert process.stdout
        url = process.stdout.readline().split()[1]
        with Page(installed(), url, *PHONE) as page:
            until(lambda: shows(page, "disabled"))
            end(process)
            until(lambda: page.evaluate("document.body.classList.contains('lost')"))
            assert disabled(page, "stop")
            assert page.evaluate("document.title") == "LOST"
            until(lambda: "the panel was ended" in text(page, "loss"))  # late, if the page is busy
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
    def waits() -> bool:
        """Unless it comes to the second token, which is right, a second after the first."""
        with visit(panel) as visitor, visit(panel) as other:
            visitor.send(json.dumps({"token": token}))
            visitor.send(json.dumps({"token": panel.token}))  # at once: the panel lets wait
            refused = heard(visitor, "refusal")
            assert refused["armed"] is False
            assert "not the token" in str(refused["refusal"])
            second = heard(visitor, "refusal")
            if second["armed"]:
                return False
            assert "wait a second" in str(second["refusal"])
            other.send(json.dumps({"token": panel.token}))
            assert heard(other, "refusal")["armed"] is True
            visitor.send('{"request": "enable"}')
            assert "not armed" in str(heard(visitor, "answer")["message"])
            return True

    until(waits)


def test_a_page_that_sleeps_is_lost_and_enables_nothing(stage: Stage) -> None:
    stage.disabled()
    since = len(stage.valves)
    with served(program=LESS_PATIENT) as panel, visit(panel) as sleeper:
        with visit(panel) as other:
            sleeper.send(json.dumps({"token": panel.token}))
            assert heard(sleeper, "refusal")["armed"] is True
            until(lambda: "an armed page" in lost_page(other))
        with pytest.raises(websockets.exceptions.ConnectionClosed):
            for _ in range(1000):
                sleeper.send('{"request": "enable"}')
                sleeper.recv(PATIENCE)
        with visit(panel) as other:
            other.send('{"request": "enable"}')
            assert heard(other, "answer")["success"] is False
    stage.report()
    assert not any(one.enabled for one in stage.valves[since:])


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
        assert (
            len(shown) < constants.LONGEST_REASON_CHARACTERS + 60
        )  # with its address, and when it was lost


def test_a_reason_that_is_no_text_ends_that_page_alone(panel: Served) -> None:
    with visit(panel) as other, visit(panel) as visitor:
        visitor.socket.sendall(b"\x88\x84\0\0\0\0\x0f\xa0\xff\xfe")  # close, 4000, not UTF-8
        until(lambda: lost_page(other))


def test_a_panel_in_a_namespace_shows_and_stops_the_crane_there_alone(
    stage: Stage, tmp_path: Path
) -> None:
    with (
        closing(Stage(tmp_path, [], namespace="left", awaited=False)) as left,
        served(*left.ros()[1:], program=PATIENT) as one,
    ):

        def shown() -> bool:
            left.enabled()
            with visit(one) as visitor:
                picture = heard(visitor, "picture")["picture"]
                assert isinstance(picture, dict)
                return (picture["namespace"], picture["state"]["word"]) == ("/left", "enabled")

        until(shown)
        with visit(one) as visitor:
            visitor.send('{"request": "stop"}')
            left.until(lambda: left.safety[0].startswith("emergency stop"))
            assert not stage.report()[0].startswith("emergency stop")
