"""What the pages of all reports share: one file that needs no network, with its data packed."""

import base64
import gzip
import json
import os
from collections.abc import Mapping
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import Any, NamedTuple
from urllib.parse import quote

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup
from plotly.offline import get_plotlyjs

# Links of a page to what it was made of; relative, so that they hold where all of it is moved.

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


def rendered(package: str, figures: Mapping[str, Any], **content: Any) -> str:
    """page.html of a package with its figures, plotly descriptions by id, and other content.

    A name that the page uses and the content lacks raises `jinja2.UndefinedError`.
    """
    environment = Environment(
        loader=PackageLoader(package, "."),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    return environment.get_template("page.html").render(
        plotly=Markup(_packed_plotly()),
        figures=Markup(_packed(json.dumps(figures, separators=(",", ":"), allow_nan=False))),
        **content,
    )


def part(package: str, name: str) -> Markup:
    """A style or script among the files of a package."""
    return Markup((files(package) / name).read_text(encoding="utf-8"))


@cache
def _packed_plotly() -> str:
    """plotly.js: 2 MB instead of 5, and its addresses stay out of the page."""
    return _packed(get_plotlyjs())


def _packed(text: str) -> str:
    """gzip in base64, which page.js unpacks; safe inside a script element."""
    return base64.b64encode(gzip.compress(text.encode(), mtime=0)).decode()
