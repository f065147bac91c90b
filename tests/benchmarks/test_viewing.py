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

MEASURED = float(os.environ.get("CRANE_LIVE_SECONDS", "30"))  # s, of each round
ROUNDS = 2
VIEWER = ("crane_viewer", "viewer", "--web-port", 0, "--data-port", 0)
MOST = 10.0  # %, by which p99 may grow with the viewer
BROWSER = next(filter(None, map(shutil.which, ("chromium", "google-chrome"))), None)
SIZE = 1280, 720  # pixels


def times(
    folder: Path,
    *beside: tuple[object, ...],
    seen: Callable[[str], AbstractContextManager[object]] = nullcontext,
) -> np.ndarray:
    """Encoder frame to valve frame [ms]."""
    folder.mkdir()
    loop = measured_loop(folder, MEASURED, beside, floored=False, seen=seen)
    found = ways(loop.bus, loop.bag, loop.window)
    return (found[:, -1] - found[:, 0]) * 1e-6


def page(printed: str) -> Page:
    """The viewer's page, in a browser."""
    address = re.search("open in a browser: (.+)", printed)
    assert BROWSER and address
    return Page(BROWSER, address[1], *SIZE)


def growth(
    folder: Path,
    measured: Callable[..., None],
    what: str,
    target: str,
    seen: Callable[[str], AbstractContextManager[object]] = nullcontext,
) -> float:
    """By how much p99 grows [%] with the viewer, and whoever has `seen` it."""
    rounds = [
        (times(folder / f"without_{k}"), times(folder / f"viewed_{k}", VIEWER, seen=seen))
        for k in range(ROUNDS)
    ]
    without, viewed = (np.concatenate(one) for one in zip(*rounds, strict=True))
    p50, p99 = np.percentile(without, [50, 99])
    viewed_p50, viewed_p99 = np.percentile(viewed, [50, 99])
    grown = 100.0 * (viewed_p99 / p99 - 1.0)
    measured(
        f"encoder frame to valve frame, without and with {what}: p50; p99; growth of p99",
        target,
        "{p50:.2f}, {viewed_p50:.2f}; {p99:.1f}, {viewed_p99:.1f} ms; {growth:+.0f} %",
        p50=p50,
        p99=p99,
        viewed_p50=viewed_p50,
        viewed_p99=viewed_p99,
        growth=grown,
    )
    return grown


def test_looking_costs_the_loop_little(
    ros_domain: int, tmp_path: Path, measured: Callable[..., None]
) -> None:
    assert growth(tmp_path, measured, "the live view", f"{MOST:g} %") <= MOST


@pytest.mark.skipif(BROWSER is None, reason="no browser")
def test_what_a_page_on_the_same_cores_costs(
    ros_domain: int, tmp_path: Path, measured: Callable[..., None]
) -> None:
    growth(tmp_path, measured, "its page in a browser on the same cores", "", page)
