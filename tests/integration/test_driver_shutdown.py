"""A driver that is ended, or killed, in the middle of a motion."""

import signal
from collections.abc import Iterator
from pathlib import Path

import pytest
from integration.driver_stage import Stage, commander

pytestmark = pytest.mark.realtime

SMALLEST = 1e-3  # two steps of the spool signal


@pytest.fixture
def stage(ros_domain: int, tmp_path: Path) -> Iterator[Stage]:
    one = Stage(tmp_path, [])
    yield one
    one.close()


def ended_by(stage: Stage, number: signal.Signals) -> int:
    """End the driver while the slew valve is open; the count of valve frames before."""
    with commander(stage) as hand:
        stage.moving(hand, slew=0.5)
        since = len(stage.valves)
        stage.driver.send_signal(number)
        stage.until(lambda: stage.driver.poll() is not None)
        stage.spin()
    return since


def test_shutdown_ramps_to_neutral(stage: Stage) -> None:
    since = ended_by(stage, signal.SIGINT)
    values = [one.commands["slew"] for one in stage.valves[since:]]
    assert stage.driver.returncode == 0
    assert values[-1] == 0.0
    assert not stage.valves[-1].enabled
    assert len([one for one in values if SMALLEST < one < 0.49]) >= 4, "not at once"


def test_a_driver_that_is_killed_leaves_the_valves_to_time_out(stage: Stage) -> None:
    ended_by(stage, signal.SIGKILL)
    assert stage.valves[-1].enabled  # no time for anything
    stage.until(lambda: stage.machine_state == "CommandTimeout")
