"""The bring-up of a simulated crane: the steps that need no person at the machine."""

import os
from collections.abc import Sequence
from functools import partial
from pathlib import Path

from crane_benchmark.rehearsal.crane_run import CraneRun
from crane_benchmark.rehearsal.live_node import start_crane, start_driver
from crane_benchmark.rehearsal.processes import Processes
from crane_driver.operator.bringup.estimates import PolarityResult
from crane_driver.operator.bringup.results import (
    MAPPING_FILE,
    RESULT_FILE,
    DeadBands,
    Result,
    Series,
)
from crane_model.configuration import load
from crane_model.result_file import ResultPart
from crane_sim.parts.parameters import SimulatedCrane

PROTOCOL = ("--seconds", 0.5, "--rate", 0.1, "--repeats", 1)  # quicker than on a machine
STEPS = ("pressures", "valves", "dead_band", "gains")  # a person moves joints for `encoders`
ANSWERS = 100  # more than any step asks


class RehearsedValve(ResultPart):
    """Bring-up's measurements of a valve."""

    joint: str
    """Joint that the valve moves."""
    sign_stays: bool
    """The sign of the command in can.yaml was confirmed."""
    dead_band: tuple[float, float]
    """Measured dead bands of positive and negative commands [-]."""
    true_dead_band: tuple[float, float]
    """Dead bands of the simulated valve [-]."""


def bring_up(
    suite: Processes, run: CraneRun, joints: Sequence[str], simulated: SimulatedCrane, seed: int
) -> list[RehearsedValve]:
    """Run the steps one after the other, each with the mapping that the one before has written.

    `ProcessError` with the end of its log if a step fails.
    """
    series = Series(run.folder / "bringup")
    yes = run.folder / "answers.txt"
    yes.write_text("yes\n" * ANSWERS, encoding="utf-8")
    port = start_crane(suite, run, seed)
    for number, step in enumerate(STEPS, start=1):
        mapping = series.newest(MAPPING_FILE)
        start_driver(suite, run, port, *(("-p", f"mapping:={mapping}") if mapping else ()))
        suite.until(partial(_ready, suite, number), "the driver does not become ready")
        if step == "pressures":
            suite.tell("crane", "engine=off")
        _answered(suite, f"bringup_{step}", step, series.folder, joints, yes)
        if step == "pressures":
            suite.tell("crane", "engine=on")
        suite.stop("driver")
    suite.stop("crane")
    return _measured(series, joints, simulated)


def _ready(suite: Processes, times: int) -> bool:
    """Return whether the driver has become ready so often; its log goes on when it restarts."""
    return suite.said("driver").count("ready: ") >= times


def _answered(
    suite: Processes, name: str, step: str, folder: Path, joints: Sequence[str], answers: Path
) -> None:
    """Run one step with answers from a file."""
    source = os.open(answers, os.O_RDONLY)
    try:
        suite.start(
            *(name, "crane_driver", "bringup", step, "--out", folder, *PROTOCOL),
            *("--joints", *joints, "--ros-args", *suite.clock),
            stdin=source,
        )
        suite.finish(name)
    finally:
        os.close(source)


def _measured(
    series: Series, joints: Sequence[str], simulated: SimulatedCrane
) -> list[RehearsedValve]:
    bands: dict[str, DeadBands] = series.dead_bands()
    path = series.newest(RESULT_FILE, "valves")
    assert path is not None  # its step has ended well
    polarities = load(path, Result[PolarityResult]).results
    found = []
    for joint in joints:
        valve = simulated.valves[joint]
        true = (valve.dead_band + valve.null_bias, valve.dead_band - valve.null_bias)
        both = bands[joint].positive.dead_band, bands[joint].negative.dead_band
        found.append(
            RehearsedValve(
                joint=joint,
                sign_stays=polarities[joint].polarity > 0,
                dead_band=both,
                true_dead_band=true,
            )
        )
    return found
