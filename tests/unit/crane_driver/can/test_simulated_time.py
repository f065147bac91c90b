"""Frames that carry simulated time, and buses that may carry them."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from crane_driver import BusSettings
from crane_driver.can.bus import check_private
from crane_driver.can.frame import (
    STEP,
    TIME,
    Frame,
    step_frame,
    time_frame,
    told_time,
)
from crane_model import ConfigurationError


@given(st.integers(0, 2**64 - 1))
def test_a_time_comes_back_from_its_own_frame_alone(time: int) -> None:
    assert told_time(time_frame(time), TIME) == told_time(step_frame(time), STEP) == time
    assert told_time(time_frame(time), STEP) is told_time(step_frame(time), TIME) is None


def test_frames_of_others_tell_no_time() -> None:
    whole = time_frame(1)
    for other in (
        whole._replace(extended=False),
        whole._replace(data=whole.data[:7]),
        Frame(0x181, bytes(8)),
    ):
        assert told_time(other, TIME) is None


@pytest.mark.parametrize(
    "settings",
    [
        BusSettings(),
        BusSettings(extra={"hop_limit": 0, "port": 5000}),
        BusSettings(interface="virtual", channel="test"),
    ],
)
def test_private_buses_are_accepted(settings: BusSettings) -> None:
    check_private(settings)


@pytest.mark.parametrize(
    "settings",
    [
        BusSettings(interface="socketcan", channel="can0"),
        BusSettings(interface="socketcan", channel="vcan0"),
        BusSettings(extra={"hop_limit": 1}),
        BusSettings(interface="pcan"),
    ],
)
def test_a_bus_that_can_leave_the_computer_is_refused(settings: BusSettings) -> None:
    with pytest.raises(ConfigurationError, match="can leave this computer.*use udp_multicast"):
        check_private(settings)
