"""How Sphinx builds the manual: `make docs`; the pages are in runs/docs/index.html."""

import sys
import xml.etree.ElementTree as ElementTree
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "docs"))

project = "Crane suite"
author = "Crane suite maintainers"
project_copyright = "Crane suite maintainers, Apache-2.0"
release = ElementTree.parse(ROOT / "src/crane_model/package.xml").findtext("version") or ""

extensions = ["myst_nb", "sphinx_copybutton"]
nitpicky = True

myst_enable_extensions = ["attrs_block", "colon_fence", "deflist"]
myst_heading_anchors = 3
# Notebooks run again only when they change.
nb_execution_mode = "cache"
nb_execution_cache_path = str(ROOT / "runs" / "docs" / "notebooks")
nb_execution_raise_on_error = True
nb_execution_timeout = 600  # s; they take less than a minute on a machine that is not busy
nb_merge_streams = True

html_theme = "furo"
html_title = f"Crane suite {release}"
html_static_path = ["_static"]
html_css_files = ["manual.css"]
html_copy_source = False
html_show_sourcelink = False
html_theme_options = {"navigation_with_keys": True}
copybutton_exclude = ".linenos, .gp, .go, .c1"  # comments beside commands are for the reader
