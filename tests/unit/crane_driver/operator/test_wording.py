"""Where there is a hand, what to do names what it can press."""

import re
from importlib.resources import files

import pytest

from crane_driver import Fault, FaultKind
from crane_driver.operator import by_hand
from crane_driver.operator.jog.jog_input import CONTROLS, REQUESTS
from crane_driver.operator.panel.crane_watch import BUTTONS, plain
from crane_driver.safety.supervisor import SafetyState
from crane_nodes.driver_client import SERVICES

TEXTS = [
    *(Fault(kind, "detail", "boom").line for kind in FaultKind),
    *(state.remedy for state in SafetyState),
    *(f"not enabled: the state is {one}; {one.cause}; {one.remedy}" for one in SafetyState),
    "boom now uses position_estimate; call reset_fault and enable",
]


@pytest.mark.parametrize("controls", [BUTTONS, CONTROLS], ids=["page", "jog"])
def test_nobody_who_has_a_hand_is_told_to_call_something(controls: dict[str, str]) -> None:
    assert any("call " in text for text in TEXTS), "else this shows nothing"
    for text in TEXTS:
        assert not re.search(r"\bcall\b", by_hand(text, controls)), text


def test_what_is_pressed_is_there_and_asks_for_that_service() -> None:
    page = (files("crane_driver.operator.panel") / "page" / "index.html").read_text()
    labels = re.findall(r"<button[^>]*>([^<]+)</button>", page)
    assert set(BUTTONS.values()) <= set(labels)
    assert set(BUTTONS) == set(SERVICES)
    assert all(REQUESTS[key] == service for service, key in CONTROLS.items())
    assert set(SERVICES) <= set(CONTROLS)


@pytest.mark.parametrize(
    ("text", "pressed"),
    [
        ("mend it, then call reset_fault", "mend it, then press Reset"),
        ("call reset_fault and enable", "press Reset and Enable"),
        ("call enable of another node", "press Enable of another node"),
        ("call enabled", "call enabled"),
        ("recall enable", "recall enable"),
        ("call substitute", "call substitute"),
    ],
)
def test_services_that_a_button_calls_become_that_button(text: str, pressed: str) -> None:
    assert by_hand(text, BUTTONS) == pressed
    assert plain({"a": [text]}) == {"a": [pressed]}
    assert by_hand(text, {}) == text
