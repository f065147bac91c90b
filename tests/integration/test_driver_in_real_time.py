"""Faults of the driver that real time alone makes: its own stall, and a bus that is lost."""

import os
import signal
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from integration.commander import Commander
from integration.driver_stage import Stage, commander
from integration.faults import DRIVER, fault, ramped, seconds_told, swing
from integration.processes import TIMING
from integration.real_time import need_real_time

from crane_driver import load_safety
from crane_model import load_machine
from crane_model.machine_files import machine_file

pytestmark = pytest.mark.realtime

SAFETY = load_safety(machine_file("safety.yaml"), load_machine())
SLACK = 1.0  # s, that a busy computer may take beyond the times of the driver


@pytest.fixture(scope="module")
def gone(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """While this file exists, the driver has no bus."""
    return tmp_path_factory.mktemp("bus") / "gone"


@pytest.fixture(scope="module")
def stage(ros_domain: int, gone: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Stage]:
    need_real_time()
    driver = DRIVER.format(gone=str(gone))
    one = Stage(tmp_path_factory.mktemp("driver"), [], driver=driver, real_time=True)
    yield one
    one.close()


@pytest.fixture
def hand(stage: Stage) -> Iterator[Commander]:
    with commander(stage) as process:
        yield process


def test_a_driver_that_was_stopped_names_its_own_stall(stage: Stage, hand: Commander) -> None:
    """The machine goes on; whatever else follows from it, this comes first."""
    swing(stage, hand)
    limit = TIMING["late"] * min(stage.codec.cycles.values())
    before = time.monotonic()
    os.kill(stage.driver.pid, signal.SIGSTOP)
    time.sleep(1.2 * limit)
    since = len(stage.valves)
    os.kill(stage.driver.pid, signal.SIGCONT)
    said = fault(stage, "stalled")
    # Stopped within its loop, it finds itself behind the bus.
    stalled = seconds_told(r"not given the processor in time: (?:after|it is) (\d+) ms", said)
    assert 1.2 * limit <= stalled <= time.monotonic() - before
    assert stage.safety[0].startswith("fault; stalled: ")
    ramped(stage, since)
    stage.disabled()


def test_a_bus_that_is_lost_is_reopened_but_never_enabled_again(
    stage: Stage, hand: Commander, gone: Path
) -> None:
    swing(stage, hand)
    before = len(stage.valves)
    gone.touch()
    try:
        stage.until(lambda: stage.machine_state == "CommandTimeout")  # no way to reach the valves
        said = fault(stage, "bus")  # as it was last told: by then no frame may go out
        assert "No such device" in said or "is lost; the frame was not sent" in said, said
        stage.until(lambda: stage.diagnostics["driver: bus"][1] == "lost")
        silent = len(stage.valves)
    finally:
        gone.unlink()
    stage.until(lambda: len(stage.valves) > silent + 200)
    assert all(one.enabled for one in stage.valves[before:silent])
    again = [one for one in stage.valves[silent:] if one.enabled or one.commands["slew"]]
    assert len(again) * stage.layout.commands[0].cycle <= SAFETY.ramp_time + SLACK
    assert stage.report()[0].startswith("fault")
    assert int(stage.diagnostics["driver: bus"][2]["times reopened"]) >= 1
    stage.disabled()
