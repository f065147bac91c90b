"""What is said of a driver that did not run."""

import math
import time

import pytest

from crane_driver import FaultKind
from crane_driver.driver_loop import StallWatch
from crane_nodes.this_computer import ProcessorTime, ThreadClock

LIMIT = 0.05  # s


@pytest.fixture
def watch() -> StallWatch:
    one = StallWatch(LIMIT)
    assert one.ran(100.0, ProcessorTime(7.0, 3.0)) is None  # however long it took to begin
    return one


def test_a_pause_up_to_the_limit_is_no_stall(watch: StallWatch) -> None:
    spent = ProcessorTime(7.0, 3.0)
    assert [watch.ran(100.0 + k * 0.99 * LIMIT, spent) for k in range(5)] == 5 * [None]


def test_a_longer_one_says_what_was_measured_and_what_to_do_once(watch: StallWatch) -> None:
    said = watch.ran(100.143, ProcessorTime(7.002, 3.140))
    assert said
    assert str(said) == (
        "stalled: the driver was not given the processor in time: after 143 ms, limit 50 ms; it "
        "computed for 2 ms and waited for a processor for 140 ms"
    )
    assert "realtime.priority" in said.remedy
    assert "reset_fault" in said.remedy
    assert watch.ran(100.148, ProcessorTime(7.003, 3.140)) is None


def test_who_has_priority_is_not_told_to_get_it(watch: StallWatch) -> None:
    said = watch.ran(100.143, ProcessorTime(7.002, 3.140, priority=50))
    assert said
    assert "realtime.priority" not in said.remedy
    assert "half of the cores" in said.remedy


@pytest.mark.parametrize("priority", [0, 50])
def test_a_process_that_was_stopped_is_told_from_one_that_waited(
    watch: StallWatch, priority: int
) -> None:
    said = watch.ran(100.143, ProcessorTime(7.002, 3.001, priority))
    assert said
    assert said.kind is FaultKind.STALLED
    assert "debugger" in said.remedy
    assert "priority" not in said.remedy


def test_without_statistics_of_the_scheduler_nothing_is_said_of_waiting() -> None:
    watch = StallWatch(LIMIT)
    watch.ran(100.0, ProcessorTime(7.0))
    said = watch.ran(100.143, ProcessorTime(7.002))
    assert said
    assert str(said).endswith("it computed for 2 ms")
    assert "realtime.priority" in said.remedy


def test_a_pause_that_the_driver_itself_worked_through_is_not_blamed_on_others(
    watch: StallWatch,
) -> None:
    said = watch.ran(100.143, ProcessorTime(7.130, 3.001))
    assert said
    assert "after 143 ms, limit 50 ms" in str(said)
    assert said.kind is FaultKind.OVERWORKED
    assert "realtime" not in said.remedy


def test_the_clock_of_a_thread_counts_what_it_computes() -> None:
    clock = ThreadClock()
    before = clock.read()
    while time.process_time() - before.computed < 0.02:
        pass
    after = clock.read()
    clock.close()
    assert after.computed - before.computed >= 0.02
    assert math.isnan(after.waited) or after.waited >= before.waited
    assert math.isnan(clock.read().waited), "closed"
