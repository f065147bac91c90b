"""Who is armed, which page is lost, and what is shown of numbers that are none."""

import json
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from crane_driver import constants
from crane_driver.operator.panel.crane_watch import ShownReadings, plain
from crane_driver.operator.panel.pages import Arming, Pages, host_allowed, legible, new_token

JSON = st.recursive(
    st.none() | st.booleans() | st.floats() | st.integers() | st.text(),
    lambda inner: st.lists(inner) | st.dictionaries(st.text(), inner),
)


@given(st.text(st.characters()))
def test_only_the_token_arms_whatever_is_given(given_text: str) -> None:
    token = new_token()
    same = given_text.strip().lower() == token
    assert (Arming(token).refusal(given_text, 0.0) == "") is same


def test_after_a_wrong_token_even_the_right_one_waits() -> None:
    arming = Arming("k7mq-2xhd")
    assert arming.refusal("\ud800", 5.0)
    assert "wait" in arming.refusal("k7mq-2xhd", 5.0 + 0.9 * constants.WRONG_TOKEN_WAIT_S)
    assert arming.refusal(" K7MQ-2xhd\n", 5.0 + constants.WRONG_TOKEN_WAIT_S) == ""


def test_a_page_that_is_lost_is_armed_no_more_and_is_told_as_armed() -> None:
    pages = Pages()
    page = pages.opened("127.0.0.1", 0.0)
    page.armed = True
    assert pages.silent(constants.PAGE_SILENCE_S) == []
    assert pages.silent(constants.PAGE_SILENCE_S + 0.01) == [page]
    lost = pages.closed(page, "12:00:00", "asleep")
    assert str(lost) == "an armed page (127.0.0.1) was lost at 12:00:00: asleep"
    assert not page.armed
    assert not pages.is_open(page)
    assert pages.closed(page, "12:00:01", "again") is None
    assert (pages.count, pages.armed) == (0, 0)


def test_a_panel_that_was_held_up_itself_takes_no_page_for_silent() -> None:
    """It has not heard meanwhile what they told; afterwards they are to tell again."""
    pages = Pages()
    page = pages.opened("127.0.0.1", 0.0)
    assert pages.silent(0.1) == []
    assert pages.silent(0.1 + 2.0 * constants.PAGE_SILENCE_S) == []
    begun, looks = 0.1 + 2.0 * constants.PAGE_SILENCE_S, round(constants.PAGE_SILENCE_S / 0.1)
    found = [pages.silent(begun + 0.1 * k) for k in range(1, looks + 1)]
    assert found[0] == []
    assert found[-1] == [page]


@given(st.text(st.characters()))
def test_a_reason_is_a_bounded_line_of_plain_characters(reason: str) -> None:
    shown = legible(reason)
    assert len(shown) == min(len(reason), constants.LONGEST_REASON_CHARACTERS)
    assert all(32 <= ord(one) < 127 for one in shown)
    if (
        reason.isascii()
        and reason.isprintable()
        and len(reason) <= constants.LONGEST_REASON_CHARACTERS
    ):
        assert shown == reason


def test_one_page_too_many_is_refused_until_one_closes() -> None:
    pages = Pages()
    opened = [pages.opened("127.0.0.1", 0.0) for _ in range(constants.MOST_PAGES)]
    assert f"limit {constants.MOST_PAGES}" in pages.refusal
    pages.closed(opened[3], "12:00:00", "left")
    assert pages.refusal == ""


@given(JSON)
def test_whatever_is_shown_is_json(content: object) -> None:
    json.dumps(plain(content), allow_nan=False)


def test_numbers_that_are_none_become_null() -> None:
    assert plain({"a": [1.0, math.nan], "b": -math.inf}) == {"a": [1.0, None], "b": None}


def test_readings_that_are_old_or_lack_a_column_are_not_shown() -> None:
    readings = ShownReadings()
    readings.take(["a", "b"], [1.0, math.nan], [2.0, 3.0], now=0.0)
    assert readings.of("a", 2, constants.OLDEST_READING_S) == [1.0, 2.0]
    assert readings.of("b", 2, 0.0) == [None, 3.0]
    assert readings.of("a", 2, 1.1 * constants.OLDEST_READING_S) == [None, None]
    readings.take(["a", "b"], [1.0, 2.0], [], now=2.0)
    assert readings.of("a", 2, 2.0) == [None, None]


@pytest.mark.parametrize(
    ("host", "allowed"),
    [
        ("localhost:8060", True),
        ("127.0.0.1", True),
        ("[::1]:8060", True),
        ("crane-pc:8060", True),
        ("evil.example", False),
        ("127.0.0.1.evil.example", False),
        ("[", False),
        ("", False),
    ],
)
def test_only_hosts_of_this_computer_are_answered(host: str, allowed: bool) -> None:
    assert host_allowed(host, ["crane-pc"]) is allowed
