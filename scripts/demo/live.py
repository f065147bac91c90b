"""The live half of the demo: the suite as processes around the simulated crane, on a CAN bus."""

import re

from crane_benchmark.rehearsal.crane_run import EXCITATION, VALIDATION, CraneRun
from crane_benchmark.rehearsal.live_node import (
    LEADING,
    VIEWER,
    Onlooker,
    Say,
    experiment,
    start,
    start_identification,
    stop,
)
from crane_benchmark.rehearsal.processes import Processes

FIT_PERIODS, VALIDATION_PERIODS = 3, 2
PAGE = "open in a browser: "


def record(suite: Processes, domain: int, law: CraneRun, seed: int, say: Say) -> None:
    """The bags of `law`, recorded live, and the identification node's model beside them.

    `ProcessError` if a process fails or an experiment ends early.
    """
    with Onlooker(suite, domain) as onlooker:
        say("starting: simulated crane, driver, trajectory, identification, recorder")
        listeners = (*LEADING, "identification")
        start(suite, law, seed, listeners=listeners)
        start_identification(suite, law)
        experiment(suite, onlooker, law, "train", EXCITATION, FIT_PERIODS, listeners)
        suite.stop("identification")
        say("a second motion, for validation")
        experiment(suite, onlooker, law, "validate", VALIDATION, VALIDATION_PERIODS, LEADING)
        stop(suite)


def show(suite: Processes, law: CraneRun) -> str:
    """Show what the topics tell in a browser; where."""
    suite.start(
        *(VIEWER, "crane_viewer", "viewer", "--machine", law.machine),
        *("--web-port", 0, "--data-port", 0, "--ros-args", *suite.clock),
    )
    found: list[str] = []

    def opened() -> bool:
        found[:] = re.findall(f"^{PAGE}(.+)$", suite.said(VIEWER), re.MULTILINE)
        return bool(found)

    suite.until(opened, "the viewer does not open its page")
    return found[0]
