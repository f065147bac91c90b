"""What it costs the control loop that somebody looks: its times with and without the viewer.

Machine, driver, controller, recorder and viewer share the cores, and where a page is open, the
browser too: without a window or a graphics card, so that it draws on the same cores. Rounds of each
kind take turns, so that whatever else the computer does meets all alike.
"""

import os
import re
import shutil
from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from pathlib import Path

import numpy as np
import pytest
from benchmarks.live_loop import measured_loop, ways

pytest.importorskip("rerun", reason="Rerun is not installed (make view)")

from integration.live_page import Page

MEASURED = float(os.environ.get("CRANE_LIVE_SECONDS", "20"))  # s, of each round
ROUNDS = 3
VIEWER = ("crane_viewer", "viewer", "--web-port", 0, "--data-port", 0)
MOST = 10.0  # %, by which p99 may grow with the viewer
BROWSER = next(filter(None, map(shutil.which, ("chromium", "google-chrome"))), None)
SIZE = 1280, 720  # pixels
HOW = {
    True: "all but the recorder in real time",
    False: "the driver alone in real time",
}


def page(printed: str) -> Page:
    """The viewer's page, in a browser."""
    address = re.search("open in a browser: (.+)", printed)
    assert BROWSER and address
    return Page(BROWSER, address[1], *SIZE)


def times(
    folder: Path,
    realtime: bool,
    *beside: tuple[object, ...],
    seen: Callable[[str], AbstractContextManager[object]] = nullcontext,
) -> np.ndarray:
    """Encoder frame to valve frame [ms]."""
    folder.mkdir()
    loop = measured_loop(folder, MEASURED, beside, floored=False, realtime=realtime, seen=seen)
    if realtime and not loop.realtime:
        pytest.skip("real time is not permitted here")
    found = ways(loop.bus, loop.bag, loop.window)
    return (found[:, -1] - found[:, 0]) * 1e-6


@pytest.mark.parametrize("realtime", HOW)
def test_looking_costs_the_loop_little(
    realtime: bool, ros_domain: int, tmp_path: Path, measured: Callable[..., None]
) -> None:
    kinds: dict[str, Callable[[Path], np.ndarray]] = {
        "nobody": lambda folder: times(folder, realtime),
        "the viewer": lambda folder: times(folder, realtime, VIEWER),
    }
    if BROWSER:
        kinds["its page in a browser on the same cores"] = lambda folder: times(
            folder, realtime, VIEWER, seen=page
        )
    rounds: dict[str, list[np.ndarray]] = {what: [] for what in kinds}
    for k in range(ROUNDS):
        for what, measure in kinds.items():
            rounds[what].append(measure(tmp_path / f"{k}_{len(rounds[what])}_{what[:5]}"))
    found = {what: np.percentile(np.concatenate(one), [50, 99]) for what, one in rounds.items()}
    (p50, p99), grown = found.pop("nobody"), {}
    for what, (viewed_p50, viewed_p99) in found.items():
        grown[what] = 100.0 * (viewed_p99 / p99 - 1.0)
        measured(
            f"encoder frame to valve frame without and with {what}, {HOW[realtime]}: p50; p99; "
            "growth of p99",
            f"{MOST:g} %" if what == "the viewer" else "",
            "{p50:.2f}, {viewed_p50:.2f}; {p99:.1f}, {viewed_p99:.1f} ms; {growth:+.0f} %",
            p50=p50,
            p99=p99,
            viewed_p50=viewed_p50,
            viewed_p99=viewed_p99,
            growth=grown[what],
        )
    assert grown["the viewer"] <= MOST
