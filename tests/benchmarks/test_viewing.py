"""What it costs the control loop that somebody looks: its times with and without the viewer.

Machine, driver, controller, recorder and viewer share the cores. Rounds with and without it take
turns, so that whatever else the computer does meets both alike.
"""

import os
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from benchmarks.live_loop import ENCODERS, cycles, measured_loop, ways

pytest.importorskip("rerun", reason="Rerun is not installed (make view)")

MEASURED = float(os.environ.get("CRANE_LIVE_SECONDS", "30"))  # s, of each round
ROUNDS = 2
VIEWER = ("crane_viewer", "viewer", "--web-port", 0, "--data-port", 0)
MOST = 1.1  # of p99 with the viewer, over that without


def times(folder: Path, *beside: tuple[object, ...]) -> np.ndarray:
    """Encoder frame to valve frame [ms]."""
    folder.mkdir()
    loop = measured_loop(folder, MEASURED, beside, floored=False)
    found = ways(loop.bus, loop.bag, cycles(loop.bus, ENCODERS), loop.window)
    return (found[:, 3] - found[:, 0]) * 1e-6


def test_looking_costs_the_loop_little(
    ros_domain: int, tmp_path: Path, measured: Callable[..., None]
) -> None:
    without, viewed = (
        np.concatenate(rounds)
        for rounds in zip(
            *(
                (times(tmp_path / f"without_{k}"), times(tmp_path / f"viewed_{k}", VIEWER))
                for k in range(ROUNDS)
            ),
            strict=True,
        )
    )
    p50, p99 = np.percentile(without, [50, 99])
    viewed_p50, viewed_p99 = np.percentile(viewed, [50, 99])
    measured(
        "encoder frame to valve frame, without and with the live view: p50; p99; growth of p99",
        "10 %",
        "{p50:.2f}, {viewed_p50:.2f}; {p99:.1f}, {viewed_p99:.1f} ms; {growth:+.0f} %",
        p50=p50,
        p99=p99,
        viewed_p50=viewed_p50,
        viewed_p99=viewed_p99,
        growth=100.0 * (viewed_p99 / p99 - 1.0),
    )
    assert viewed_p99 <= MOST * p99
