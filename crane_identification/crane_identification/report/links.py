"""Links of a page to what it was made of; relative, so that they hold where all of it is moved."""

import os
from pathlib import Path
from typing import NamedTuple
from urllib.parse import quote

PAGE = "report.html"


class PageLink(NamedTuple):
    """What is clicked, and where it leads."""

    text: str
    address: str


def link(target: str, folder: Path) -> PageLink:
    """From a page in `folder` to a file or folder, by the name that the user gave it."""
    return PageLink(target, quote(os.path.relpath(Path(target).resolve(), folder.resolve())))


def page_of(model_file: str, folder: Path) -> PageLink | None:
    """To the page beside a model file; None where there is none, or where it is this one."""
    beside = Path(model_file).parent
    if beside.resolve() == folder.resolve() or not (beside / PAGE).is_file():
        return None
    return link(str(beside / PAGE), folder)
