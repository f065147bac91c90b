"""What is said of a driver that did not run."""

import pytest

from crane_driver.faults import FaultKind
from crane_driver.safety.stalls import StallWatch

LIMIT = 0.05  # s


@pytest.fixture
def watch() -> StallWatch:
    one = StallWatch(LIMIT)
    assert one.ran(100.0, 7.0) is None  # however long it took to begin
    return one


def test_a_pause_up_to_the_limit_is_no_stall(watch: StallWatch) -> None:
    assert [watch.ran(100.0 + k * 0.99 * LIMIT, 7.0) for k in range(5)] == 5 * [None]


def test_a_longer_one_names_how_long_the_limit_and_what_to_do_once(watch: StallWatch) -> None:
    said = watch.ran(100.143, 7.002)
    assert said
    assert (
        str(said)
        == "stalled: the driver was not given the processor in time: after 143 ms, limit 50 ms"
    )
    assert "realtime.priority" in said.remedy
    assert "reset_fault" in said.remedy
    assert watch.ran(100.148, 7.003) is None


def test_a_pause_that_the_driver_itself_worked_through_is_not_blamed_on_others(
    watch: StallWatch,
) -> None:
    said = watch.ran(100.143, 7.130)
    assert said
    assert "after 143 ms, limit 50 ms" in str(said)
    assert said.kind is FaultKind.OVERWORKED
    assert "realtime" not in said.remedy
