"""A driver that is ended, crashes or is killed in the middle of a motion."""

import signal
from collections.abc import Iterator

import pytest
from integration.commander import Commander
from integration.driver_stage import Stage
from integration.faults import SMALLEST, UNHINDERED, swing
from integration.processes import DRIVER, IMPATIENT, MACHINE

# A driver with a programming error that shows itself on SIGUSR1.
FAULTY = """
import signal, sys
from crane_driver.driver_loop import DriverLoop
from crane_driver.driver_node import main
check, signals = DriverLoop.check, []
signal.signal(signal.SIGUSR1, lambda number, frame: signals.append(number))
def fail(loop, *arguments):
    if signals:
        raise ZeroDivisionError("raised in a callback")
    check(loop, *arguments)
DriverLoop.check = fail
sys.exit(main(sys.argv[1:]))
"""


@pytest.fixture(scope="module")
def stage(ros_domain: int, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Stage]:
    one = Stage(tmp_path_factory.mktemp("driver"), [], simulation=IMPATIENT + MACHINE)
    yield one
    one.close()


def ended_by(stage: Stage, hand: Commander, *signals: signal.Signals, program: str = DRIVER) -> int:
    """End the driver while the slew valve is open; the number of valve frames before that."""
    if stage.driver.poll() is not None:
        stage.start_driver(program)
    swing(stage, hand, UNHINDERED)
    since = len(stage.valves)
    for number in signals:
        stage.driver.send_signal(number)
        stage.spin()
    stage.until(lambda: stage.driver.poll() is not None)
    return since


def assert_ramp(stage: Stage, since: int) -> None:
    """Down to neutral, and not at once."""
    stage.until(lambda: not stage.valves[-1].enabled)
    values = [abs(one.commands["slew"]) for one in stage.valves[since:]]
    assert values[-1] == 0.0
    assert len([one for one in values if SMALLEST < one < UNHINDERED - 0.01]) >= 4, values


def test_shutdown_ramps_to_neutral_however_often_ctrl_c_is_pressed(
    stage: Stage, hand: Commander
) -> None:
    since = ended_by(stage, hand, *[signal.SIGINT] * 4)
    assert stage.driver.returncode == 0
    assert_ramp(stage, since)


def test_the_end_of_its_terminal_ramps_to_neutral(stage: Stage, hand: Commander) -> None:
    since = ended_by(stage, hand, signal.SIGHUP)
    assert stage.driver.returncode == 0
    assert_ramp(stage, since)


def test_an_error_in_a_callback_ramps_to_neutral(stage: Stage, hand: Commander) -> None:
    since = ended_by(stage, hand, signal.SIGUSR1, program=FAULTY)
    assert stage.driver.returncode == 1
    assert_ramp(stage, since)


def test_a_driver_that_is_killed_leaves_the_valves_to_time_out(
    stage: Stage, hand: Commander
) -> None:
    ended_by(stage, hand, signal.SIGKILL)
    assert stage.valves[-1].enabled  # no time for anything
    stage.until(lambda: stage.machine_state == "CommandTimeout")
