"""The README is a cover: short. What pages point to is there."""

import re

import pytest
from manual import PAGES, ROOT, text

FILE = re.compile(r"`((?:src|crane_[a-z]+|docs|scripts|tests)/[\w./-]+\.\w+)`")
LINK = re.compile(r"\]\((?!https?://)([^)#]+)")


def test_it_is_short() -> None:
    assert len(text("README.md").splitlines()) <= 200


@pytest.mark.parametrize("page", ["README.md", "CONTRIBUTING.md"])
def test_its_links_lead_somewhere(page: str) -> None:
    targets = LINK.findall(text(page))
    assert targets
    assert [one for one in targets if not (ROOT / one).exists()] == []


@pytest.mark.parametrize("page", PAGES)
def test_files_that_it_names_are_there(page: str) -> None:
    assert [one for one in FILE.findall(text(page)) if not (ROOT / one).exists()] == []


def test_such_names_are_recognised() -> None:
    assert sum(len(FILE.findall(text(page))) for page in PAGES) > 10
