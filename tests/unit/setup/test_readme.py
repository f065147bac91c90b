"""The README is a cover: short, and what it points to is there."""

import re

import pytest
from manual import ROOT, text

LINK = re.compile(r"\]\((?!https?://)([^)#]+)")


def test_it_is_short() -> None:
    assert len(text("README.md").splitlines()) <= 200


@pytest.mark.parametrize("page", ["README.md", "CONTRIBUTING.md"])
def test_its_links_lead_somewhere(page: str) -> None:
    targets = LINK.findall(text(page))
    assert targets
    assert [one for one in targets if not (ROOT / one).exists()] == []
