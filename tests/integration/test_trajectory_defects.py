"""A defect in the program that leads the crane ends the goal in words, and the crane at rest."""

from pathlib import Path

import numpy as np
import pytest
from integration.driver_stage import Stage
from integration.experiments import TRAJECTORY, Experiments
from integration.processes import end

from crane_trajectory import Outcome

BROKEN = """
import {module} as module
whole = module.{function}
def broken(*given):
    if {when}:
        raise ZeroDivisionError("made by a test")
    return whole(*given)
module.{function} = broken
"""
MOVING = "abs(given[2]).max() > 0.03"
LED = "getattr(given[0], '_experiment', None) and given[0]._experiment.elapsed > 1.0"
DEFECTS = {
    "law": ("crane_trajectory.experiment", "command", MOVING),
    "watch": ("crane_trajectory.trajectory_node", "several_sources", LED),
    "feedback": ("crane_trajectory.run_excitation_action", "feedback_message",
                 "given[0].elapsed > 1.0"),
    "beginning": ("crane_trajectory.trajectory_node", "Experiment", "True"),
    "planning": ("crane_trajectory.trajectory_node", "plan", "True"),
}  # fmt: skip


@pytest.mark.parametrize("place", DEFECTS)
def test_a_defect_ends_the_goal_with_a_message_and_the_crane_at_rest(
    stage: Stage, tmp_path: Path, place: str
) -> None:
    module, function, when = DEFECTS[place]
    program = BROKEN.format(module=module, function=function, when=when) + TRAJECTORY
    crane = Experiments(stage, tmp_path, program=program)
    try:
        result = crane.ended(Outcome.FAILED, periods=2)
        assert "ZeroDivisionError: made by a test" in result.message
        assert "report it" in result.message
        crane.holds_still()
        moved = place in ("law", "watch", "feedback")
        assert any(np.any(one.command) for one in crane.commands) is moved
        stage.until(lambda: not crane.commands or not np.any(crane.commands[-1].command))
        assert stage.report()[0] == "enabled", "the driver had to stop the crane"
        assert crane.process.poll() is None
    finally:
        stage.end(crane.process)


def test_a_defect_beside_it_ends_the_node_with_the_crane_at_rest_and_the_goal_answered(
    stage: Stage, tmp_path: Path
) -> None:
    reports = BROKEN.format(
        module="crane_trajectory.trajectory_node",
        function="condition",
        when="given[2] and given[2].elapsed > 1.0",
    )
    crane = Experiments(stage, tmp_path, program=reports + TRAJECTORY)
    try:
        stage.enabled()
        ending = crane.send(periods=2).get_result_async()
        stage.until(lambda: ending.done() and crane.process.poll() is not None)
    finally:
        status = end(crane.process)
    result = ending.result().result
    assert result.outcome == Outcome.DEACTIVATED, result.message
    assert status != 0
    assert result.message.startswith("the node was shut down, the crane is at rest")
    crane.holds_still()
