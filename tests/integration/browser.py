"""Pages in a real browser without a window: what is drawn, and what the console says."""

import shutil
import subprocess
from pathlib import Path
from typing import NamedTuple

import pytest
from unit.crane_identification.report.html_reader import Element, read_html

BROWSERS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
FLAGS = (
    "--headless",
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--enable-logging=stderr",
    "--virtual-time-budget=60000",  # the clock of the page, which stands while it computes
)


class Opened(NamedTuple):
    """A page after its scripts have run."""

    page: Element
    console: list[str]

    def plots(self) -> list[Element]:
        """The places of figures; each is drawn, or the test fails."""
        places = self.page.find("div", class_="plot")
        for place in places:
            assert place.find("svg", class_="main-svg"), place.attributes["id"]
        assert self.page.find("p", id="no-figures")[0].attributes.get("hidden") is not None
        return places


def installed() -> str:
    """Path of the browser; the test is skipped where there is none."""
    for name in BROWSERS:
        if path := shutil.which(name):
            return path
    pytest.skip(f"none of {', '.join(BROWSERS)} is installed; the page was not opened")


def opened(browser: str, folder: Path, html: str) -> Opened:
    """A page, written into `folder`, with all that it hides unfolded."""
    page = folder / "report.html"
    page.write_text(html.replace("<details>", "<details open>"), encoding="utf-8")
    result = run(browser, folder, "--dump-dom", page.as_uri())
    console = [line for line in result.stderr.splitlines() if "CONSOLE" in line]
    return Opened(read_html(result.stdout), console)


def run(browser: str, folder: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    """The browser with a profile of its own."""
    return subprocess.run(
        [browser, *FLAGS, f"--user-data-dir={folder / 'profile'}", *arguments],
        capture_output=True,
        text=True,
        timeout=300,
        check=True,
    )
