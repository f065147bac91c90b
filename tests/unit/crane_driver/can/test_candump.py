"""Reading logs of candump: exact, and going on after what is damaged."""

from pathlib import Path

import can
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from crane_driver.can.bus_log import Clock
from crane_driver.can.frame import Frame
from crane_driver.can.log_formats import CandumpLog, open_log
from crane_model import DataError


def read(tmp_path: Path, text: str, channel: str | None = None) -> tuple[CandumpLog, list[Frame]]:
    path = tmp_path / "bus.log"
    path.write_text(text)
    log = CandumpLog(path, channel)
    return log, list(log.frames())


def test_stamps_identifiers_and_data_are_exact(tmp_path: Path) -> None:
    _, frames = read(
        tmp_path,
        "(1626905042.645596) can1 0CF00400#507D8DD11200F48E\n"
        "(1626905042.6455961) can1 123#\n"
        "(0.000000007) can1 7ff#aB R\n",
    )
    assert [(one.stamp, one.id, one.extended, one.data) for one in frames] == [
        (1626905042_645596000, 0x0CF00400, True, bytes.fromhex("507D8DD11200F48E")),
        (1626905042_645596100, 0x123, False, b""),
        (7, 0x7FF, False, b"\xab"),
    ]


def test_a_frame_with_flexible_data_rate_is_read(tmp_path: Path) -> None:
    _, (frame,) = read(tmp_path, "(1.0) can0 123##1" + "11" * 12)
    assert frame.data == b"\x11" * 12


def test_damaged_lines_are_counted_and_skipped(tmp_path: Path) -> None:
    log, frames = read(
        tmp_path,
        "(1.0) can0 123#11\n"
        "(1.1) can0 123#1\n"  # half a byte
        "(1.2) can0 12#11\n"
        "\x00\x00\x00\n"
        "\n"
        "(1.3) can0 123#22\n"
        "(1.4) can0 12",  # the power went
    )
    assert [one.data for one in frames] == [b"\x11", b"\x22"]
    assert (log.lines, log.damaged) == (6, 4)


def test_a_byte_order_mark_damages_no_line(tmp_path: Path) -> None:
    log, frames = read(tmp_path, "\ufeff(1.0) can0 123#11\n(1.1) can0 123#22\n")
    assert [frame.data for frame in frames] == [b"\x11", b"\x22"]
    assert log.damaged == 0


@pytest.mark.parametrize(
    ("shown", "clock"),
    [("(1700000000.250000)", Clock.EPOCH), ("(2023-11-14 22:13:20.250000)", Clock.LOCAL)],
)
def test_the_screen_of_candump_is_read_if_its_stamps_tell_when(
    shown: str, clock: Clock, tmp_path: Path
) -> None:
    path = tmp_path / "bus.log"
    path.write_text(
        f" {shown}  can0  123   [2]  11 FF\n"
        f" {shown}  can0  RX - -  00000123   [2]  11 22   '.\"'\n"
        f" {shown}  can0  123   [0]  remote request\n"
        f" {shown}  can0  123   [2]  11\n"
    )
    log = open_log(path)
    frames = list(log.frames())
    assert {frame.stamp for frame in frames} == {1_700_000_000_250_000_000}
    assert [frame.data for frame in frames] == [b"\x11\xff", b"\x11\x22"]
    assert [frame.extended for frame in frames] == [False, True]
    assert (log.clock, log.remote, log.damaged) == (clock, 1, 1)


def test_a_raw_length_behind_the_data_damages_no_line(tmp_path: Path) -> None:
    log, (frame,) = read(tmp_path, "(1.0) can0 123#1122334455667788_9\n")  # of candump -8
    assert (len(frame.data), log.damaged) == (8, 0)


@pytest.mark.parametrize("encoding", ["utf-16", "utf-16-le", "utf-16-be"])
def test_a_log_that_a_shell_of_windows_wrote_is_read(encoding: str, tmp_path: Path) -> None:
    path = tmp_path / "bus.log"
    path.write_bytes("(1.0) can0 123#11\r\n(1.1) can0 123#22\r\n".encode(encoding))
    log = open_log(path)
    assert [frame.data for frame in log.frames()] == [b"\x11", b"\x22"]
    assert log.damaged == 0


def test_error_and_remote_frames_are_no_data(tmp_path: Path) -> None:
    log, frames = read(
        tmp_path,
        "(1.0) can0 20000040#0000000000000000\n(1.1) can0 123#R\n(1.2) can0 123#R8\n",
    )
    assert frames == []
    assert (log.errors, log.remote, log.damaged) == (1, 2, 0)


def test_a_log_of_several_channels_needs_to_be_told_which(tmp_path: Path) -> None:
    text = "(1.0) can0 123#11\n(1.1) can1 123#22\n"
    with pytest.raises(DataError, match="frames of channels can0 and can1; say which"):
        read(tmp_path, text)
    log, frames = read(tmp_path, text, "can1")
    assert [one.data for one in frames] == [b"\x22"]
    assert log.others == 1


def test_progress_reaches_the_size_of_the_file(tmp_path: Path) -> None:
    path = tmp_path / "bus.log"
    path.write_text("(1.0) can0 123#11\n" * 10)
    seen: list[int] = []
    list(CandumpLog(path).frames(seen.append))
    assert sum(seen) == path.stat().st_size


def test_an_absent_log_is_named(tmp_path: Path) -> None:
    with pytest.raises(DataError, match="absent.log: cannot be read"):
        list(CandumpLog(tmp_path / "absent.log").frames())


@settings(deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    st.lists(
        st.tuples(
            st.integers(0, 2_000_000_000),
            st.booleans(),
            st.integers(0, 0x7FF),
            st.binary(max_size=8),
        ),
        max_size=5,
    )
)
def test_what_python_can_writes_is_read(
    tmp_path: Path, messages: list[tuple[int, bool, int, bytes]]
) -> None:
    path = tmp_path / "bus.log"
    with can.CanutilsLogWriter(path) as writer:
        for second, extended, identifier, data in sorted(messages):
            writer.on_message_received(
                can.Message(
                    timestamp=second,
                    is_extended_id=extended,
                    arbitration_id=identifier,
                    data=data,
                    channel="can0",
                )
            )
    log = CandumpLog(path)
    assert [
        (frame.stamp // 10**9, frame.extended, frame.id, frame.data) for frame in log.frames()
    ] == sorted(messages)
    assert log.damaged == 0
