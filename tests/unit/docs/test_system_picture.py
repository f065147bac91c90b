"""Diagrams show nodes, topics, commands and verdicts that exist; no box is over another."""

import re
from itertools import combinations

from from_code.system_picture import (
    DIAGNOSIS,
    DIAGNOSIS_ARROWS,
    LIVE,
    LIVE_ARROWS,
    OFFLINE,
    OFFLINE_ARROWS,
    pages,
)
from manual import text

from crane_identification.diagnosis.findings import Verdict

REFERENCE = text("docs/reference/nodes.md") + text("docs/reference/topics.md")
COMMANDS = text("docs/reference/command_line.md")


def test_topics_and_services_are_those_of_the_reference() -> None:
    words = " ".join(line for arrow in LIVE_ARROWS for line in arrow.lines)
    found = re.findall(r"~?/[\w/]+", words)
    assert len(found) > 10
    assert all(f"`{name}`" in REFERENCE for name in found)


def test_nodes_and_commands_exist() -> None:
    boxes = [box for box in (*LIVE.values(), *OFFLINE.values()) if not box.file]
    names = re.findall(r"\w+", " ".join(line for box in boxes for line in box.lines))
    known = REFERENCE + COMMANDS
    assert all(re.search(rf"\b{name}`", known) for name in names if name not in ("crane", "or"))


def test_arrows_join_boxes_and_boxes_do_not_overlap() -> None:
    diagrams = (LIVE, LIVE_ARROWS), (OFFLINE, OFFLINE_ARROWS), (DIAGNOSIS, DIAGNOSIS_ARROWS)
    for boxes, arrows in diagrams:
        assert {name for arrow in arrows for name in (arrow.start, arrow.end)} == set(boxes)
        for a, b in combinations(boxes.values(), 2):
            apart_x = abs(a.x - b.x) > a.half[0] + b.half[0]
            assert apart_x or abs(a.y - b.y) > a.half[1] + b.half[1], (a, b)


def test_heads_of_arrows_are_not_under_boxes() -> None:
    for page, boxes in zip(pages().values(), (LIVE, OFFLINE, DIAGNOSIS), strict=True):
        for x, y in re.findall(r'class="head" d="M([\d.]+) ([\d.]+)', page):
            for box in boxes.values():
                inside_x = abs(float(x) - box.x) < box.half[0] - 0.5
                assert not (inside_x and abs(float(y) - box.y) < box.half[1] - 0.5), box


def test_the_flow_chart_ends_at_every_verdict() -> None:
    ends = set(DIAGNOSIS) - {arrow.start for arrow in DIAGNOSIS_ARROWS}
    assert sorted(DIAGNOSIS[name].lines[0] for name in ends) == sorted(Verdict)


def test_all_pictures_are_made() -> None:
    assert all("<svg" in page for page in pages().values()) and len(pages()) == 3
