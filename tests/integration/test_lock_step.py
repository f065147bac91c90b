"""On simulated time a run can be repeated to the last bit, whatever happens to its processes."""

import os
import signal
import subprocess
import time
from pathlib import Path

import numpy as np
import pytest
from integration.lock_step import SHORT_PATIENCE, Suite, assert_same, signals
from integration.processes import DRIVER, MACHINE, PATIENCE, environment, free_port, line

from crane_bags.types import GENERALIZED_FORCES
from crane_interfaces.msg import DriverState

STOPPED = ("crane", "driver", "trajectory", "identification", "recorder")


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory: pytest.TempPathFactory, ros_domain: int) -> Path:
    """The bag of a run that nobody disturbs."""
    with Suite(tmp_path_factory.mktemp("undisturbed") / "suite", seed=1) as suite:
        suite.completed()
    return suite.bag


def test_the_same_seed_gives_the_same_signals_whichever_process_is_stopped(
    undisturbed: Path, tmp_path: Path, ros_domain: int
) -> None:
    """Each in turn, for a while, while the crane moves: nothing is lost, nothing is late."""
    with Suite(tmp_path / "suite", seed=1) as suite:
        suite.until(lambda: suite.driver.state.state == DriverState.STATE_ENABLED)
        for seconds in (0.5, 2.0, 30.0):
            for name in STOPPED:
                suite.moved_on(0.25)
                suite.processes[name].send_signal(signal.SIGSTOP)
                time.sleep(seconds)
                suite.processes[name].send_signal(signal.SIGCONT)
        assert suite.driver.newest.state == DriverState.STATE_ENABLED
        suite.completed()
    recorded = signals(suite.bag)
    assert_same(signals(undisturbed), recorded)
    forces = recorded[GENERALIZED_FORCES.name]["measured"]
    forces[len(forces) // 2] = np.nextafter(forces[len(forces) // 2], np.inf)
    with pytest.raises(AssertionError, match="measured"):  # the last bit counts
        assert_same(signals(undisturbed), recorded)


@pytest.mark.parametrize(
    ("killed", "fault"),
    [
        ("crane", DriverState.FAULT_LATE),
        ("trajectory", DriverState.FAULT_COMMAND_TIMEOUT),
    ],
)
def test_a_process_that_dies_ends_in_its_fault(
    tmp_path: Path, ros_domain: int, killed: str, fault: int
) -> None:
    with Suite(tmp_path / "suite", seed=1, program=SHORT_PATIENCE) as suite:
        suite.until(lambda: suite.driver.state.state == DriverState.STATE_ENABLED)
        suite.until(lambda: suite.commanded)
        suite.moved_on(1.0)
        suite.processes[killed].kill()
        suite.until(lambda: suite.driver.newest.state == DriverState.STATE_FAULT)
        assert suite.driver.newest.fault == fault, suite.logs()


def test_without_its_driver_the_valves_close_and_the_experiment_ends(
    tmp_path: Path, ros_domain: int
) -> None:
    with Suite(tmp_path / "suite", seed=1, program=SHORT_PATIENCE) as suite:
        suite.until(lambda: suite.driver.state.state == DriverState.STATE_ENABLED)
        suite.until(lambda: suite.commanded)
        suite.moved_on(1.0)
        suite.processes["driver"].kill()
        suite.until(lambda: suite.processes["excitation"].poll() is not None)
        assert "STATES_LOST" in suite.logs()
        suite.until(lambda: "valves: CommandTimeout" in suite.logs())


def test_a_recorder_that_dies_is_missed_by_nobody(tmp_path: Path, ros_domain: int) -> None:
    with Suite(tmp_path / "suite", seed=1, program=SHORT_PATIENCE) as suite:
        suite.until(lambda: suite.driver.state.state == DriverState.STATE_ENABLED)
        suite.until(lambda: suite.commanded)
        suite.moved_on(1.0)
        suite.processes["recorder"].kill()
        suite.completed()


def refusal(program: str, *arguments: str) -> str:
    """The only line of a process that refuses to run."""
    done = subprocess.run(
        line(program, *arguments),
        env=environment() | {"ROS_DOMAIN_ID": os.environ["ROS_DOMAIN_ID"]},
        capture_output=True,
        text=True,
        timeout=PATIENCE,
    )
    assert done.returncode == 1
    lines = [one for one in done.stderr.splitlines() if "can leave this computer" in one]
    assert len(lines) == 1, done.stderr
    return lines[0]


def test_real_valves_are_never_on_simulated_time(ros_domain: int) -> None:
    bus = ("--interface", "socketcan", "--channel", "can0")
    assert "socketcan can0" in refusal(MACHINE, "--lock-step", *bus)
    hops = ("--bus-option", "hop_limit=1", "--bus-option", f"port={free_port()}")
    assert "hop_limit 1" in refusal(MACHINE, "--lock-step", *hops)
    real = ("-p", "bus.interface:=socketcan", "-p", "bus.channel:=can0")
    simulated = ("--ros-args", "-p", "use_sim_time:=true", *real)
    assert "use udp_multicast" in refusal(DRIVER, *simulated)
