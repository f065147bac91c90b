"""How Sphinx builds the manual: `make docs`; the pages are in runs/docs/html."""

import os
import re
import shutil
import subprocess
import sys
import xml.etree.ElementTree as ElementTree
from pathlib import Path

from docutils import nodes
from latex2mathml.converter import convert
from myst_nb.core import render
from nbformat import NotebookNode
from sphinx.application import Sphinx
from sphinx.environment import BuildEnvironment
from sphinx.util import logging
from sphinx.writers.html5 import HTML5Translator

DOCS = Path(__file__).resolve().parent
ROOT = DOCS.parent

project = "Crane suite"
author = "Crane suite maintainers"
project_copyright = "Crane suite maintainers, Apache-2.0"
release = ElementTree.parse(ROOT / "src/crane_model/package.xml").findtext("version") or ""

extensions = ["myst_nb", "sphinx.ext.autodoc", "sphinx.ext.napoleon", "sphinx_copybutton"]

myst_enable_extensions = ["attrs_block", "colon_fence", "deflist", "dollarmath"]
myst_dmath_allow_space = False  # $model in a sentence is no equation
html_math_renderer = "mathml"
myst_heading_anchors = 3
# Notebooks run again only when they change.
nb_execution_mode = "cache"
nb_execution_cache_path = str(ROOT / "runs" / "docs" / "notebooks")
nb_execution_raise_on_error = True
nb_execution_timeout = 600  # s; they take less than a minute on a machine that is not busy
nb_merge_streams = True
nb_output_stderr = "remove"  # progress
os.environ["JUPYTER_PATH"] = str(DOCS / "_kernel")  # a kernel that does not warn of its own socket

html_theme = "furo"
html_title = f"Crane suite {release}"
html_static_path = ["_static"]
html_css_files = ["manual.css"]
html_copy_source = False
html_show_sourcelink = False
html_theme_options = {"navigation_with_keys": True}
copybutton_exclude = ".linenos, .gp, .go, .c1"  # comments beside commands are for the reader

autodoc_typehints = "signature"
autodoc_typehints_format = "short"
autodoc_member_order = "bysource"
autodoc_default_options = {"exclude-members": "model_config"}  # of pydantic
toc_object_entries = False
python_use_unqualified_type_names = True
default_role = "literal"  # `name` in docstrings
SPECIAL = re.compile(r"(?P<code>``?[^`]+``?)|(?P<sign>[*|\\]|_\b)")


def escape(app: Sphinx, what: str, name: str, obj: object, opts: object, lines: list[str]) -> None:
    """Keep plain text in docstrings, as |q| or q*, from being taken for markup."""
    lines[:] = [SPECIAL.sub(lambda m: m["code"] or "\\" + m["sign"], line) for line in lines]


def leave_out(
    app: Sphinx, what: str, name: str, obj: object, skip: bool, opts: object
) -> bool | None:
    """Leave out what a generic class was made for, as `Table[float]`: pydantic names it, too."""
    return True if "[" in name else None


def joined(outputs: list[NotebookNode]) -> list[NotebookNode]:
    """What a cell prints, in one piece: it comes in pieces of 100 bytes, and myst-nb would end a
    line at each of them.
    """
    streams: dict[str, NotebookNode] = {}
    for one in outputs:
        if one.output_type == "stream":
            whole = streams.setdefault(one.name, NotebookNode(one, text=""))
            whole.text += one.text
    return [*streams.values(), *(one for one in outputs if one.output_type != "stream")]


render.coalesce_streams = joined
REPORTS = {
    "identification": ("tutorials/bag_to_parameters", "tutorial_identify/fit/report.html"),
    "diagnosis": ("tutorials/missing_effect", "tutorial_effect/diagnosis/report.html"),
}
"""Reports of the gallery: the tutorial that makes each, and its place in runs."""
TAG = re.compile(r"\\tag\{([^}]*)\}")


def inline_equation(writer: HTML5Translator, node: nodes.math) -> None:
    """Write an equation within a line as MathML, which needs neither script nor network."""
    writer.body.append(convert(node.astext()))
    raise nodes.SkipNode


def displayed_equation(writer: HTML5Translator, node: nodes.math_block) -> None:
    """Write an equation on a line of its own, with the number of its tag behind it."""
    latex = node.astext()
    number = "".join(f"<span>({tag})</span>" for tag in TAG.findall(latex))
    equation = convert(TAG.sub("", latex), display="block")
    writer.body.append(f'<div class="equation">{equation}{number}</div>\n')
    raise nodes.SkipNode


LOADED = re.compile(r"<(?:script|link|img|iframe)\b[^>]* (?:src|href)=\"(?:https?:)?//[^\"]*")


def make_pages(app: Sphinx) -> None:
    """Write the pages that are made from the code, in a process of its own: it starts ROS."""
    environment = os.environ | {"PYTHONPATH": f"{DOCS}:{os.environ.get('PYTHONPATH', '')}"}
    command = [sys.executable, "-m", "from_code", str(DOCS / "reference" / "generated")]
    subprocess.run(command, check=True, env=environment)


def reports_missing(
    app: Sphinx,
    environment: BuildEnvironment,
    added: set[str],
    changed: set[str],
    removed: set[str],
) -> list[str]:
    """Return the tutorials to run again, because their reports for the gallery are gone."""
    missing = [page for page, report in REPORTS.values() if not (ROOT / "runs" / report).is_file()]
    if missing:
        shutil.rmtree(nb_execution_cache_path, ignore_errors=True)
    return missing


def copy_reports(app: Sphinx, error: Exception | None) -> None:
    """Copy the reports of the gallery next to the pages; warn, and so fail, without them."""
    folder = Path(app.outdir) / "reports"
    folder.mkdir(exist_ok=True)
    for name, (page, report) in REPORTS.items() if not error else ():
        if (source := ROOT / "runs" / report).is_file():
            shutil.copyfile(source, folder / f"{name}.html")
        else:
            logging.getLogger(__name__).warning("gallery: %s did not make runs/%s", page, report)


def check_offline(app: Sphinx, error: Exception | None) -> None:
    """Warn of a page that loads something from a network, and so fail."""
    for page in [] if error else Path(app.outdir).rglob("*.html"):
        if found := LOADED.search(page.read_text("utf-8")):
            logging.getLogger(__name__).warning("%s needs a network: %s", page, found[0])


def setup(app: Sphinx) -> None:
    """What Sphinx calls first."""
    app.add_html_math_renderer("mathml", (inline_equation, None), (displayed_equation, None))
    app.connect("builder-inited", make_pages)
    app.connect("autodoc-process-docstring", escape)
    app.connect("autodoc-skip-member", leave_out)
    app.connect("env-get-outdated", reports_missing)
    app.connect("build-finished", copy_reports)
    app.connect("build-finished", check_offline)
