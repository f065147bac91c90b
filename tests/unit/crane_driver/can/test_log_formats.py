"""Logs of any tool are told by their content, and none is called damaged for being of another."""

import gzip
from collections.abc import Callable
from pathlib import Path
from typing import Any
from zoneinfo import ZoneInfo

import can
import polars as pl
import pytest

from crane_driver.can.bus_log import Clock
from crane_driver.can.log_formats import open_log
from crane_driver.decode import main
from crane_model import DataError

START = 1_700_000_000.0  # s
FRAMES = [
    can.Message(
        timestamp=START + 0.01 * number,
        arbitration_id=identifier,
        is_extended_id=extended,
        data=bytes((number, 2, 255)),
        channel=1,
        is_rx=True,
    )
    for number, (identifier, extended) in enumerate([(0x123, False), (0x0CF00400, True)] * 5)
]
BESIDE = [
    can.Message(timestamp=START + 0.2, arbitration_id=0x7FF, is_extended_id=False,
                is_remote_frame=True, channel=1),
    can.Message(timestamp=START + 0.3, is_error_frame=True, channel=1),
]  # fmt: skip

SUFFIXES = (".log", ".blf", ".asc", ".trc", ".csv", ".db")


def write(path: Path, messages: list[can.Message]) -> Path:
    with can.Logger(path) as writer:
        for message in messages:
            writer.on_message_received(message)
    return path


@pytest.fixture(autouse=True)
def in_utc(monkeypatch: pytest.MonkeyPatch) -> None:
    """ASC states local time, to the second of its writer."""
    monkeypatch.setenv("TZ", "UTC")


@pytest.mark.parametrize("suffix", SUFFIXES)
@pytest.mark.parametrize("named", [True, False])
def test_frames_of_every_format_that_python_can_writes(
    suffix: str, named: bool, tmp_path: Path
) -> None:
    path = write(tmp_path / f"bus{suffix}", FRAMES)
    if not named:
        path = path.rename(tmp_path / "bus.txt")
    log = open_log(path)
    frames = list(log.frames())
    assert [(one.id, one.extended, one.data) for one in frames] == [
        (one.arbitration_id, one.is_extended_id, bytes(one.data)) for one in FRAMES
    ]
    since = [(one.stamp - frames[0].stamp) / 1e9 for one in frames]
    assert since == pytest.approx([0.01 * number for number in range(10)], abs=1.1e-3)
    assert frames[0].stamp / 1e9 == pytest.approx(START, abs=1.0), "of UTC, where it was written"
    assert (log.damaged, log.broken) == (0, "")


@pytest.mark.parametrize("suffix", [".blf", ".asc", ".csv"])
def test_remote_and_error_frames_are_no_data(suffix: str, tmp_path: Path) -> None:
    log = open_log(write(tmp_path / f"bus{suffix}", [*FRAMES, *BESIDE]))
    assert len(list(log.frames())) == len(FRAMES)
    assert (log.remote, log.errors) == (1, 1)


@pytest.mark.parametrize("suffix", [".asc", ".log", ".trc"])
def test_a_compressed_log(suffix: str, tmp_path: Path) -> None:
    path = write(tmp_path / f"bus{suffix}", FRAMES)
    path.write_bytes(gzip.compress(path.read_bytes()))
    assert len(list(open_log(path).frames())) == len(FRAMES)


@pytest.mark.parametrize("suffix", [".asc", ".log"])
def test_what_was_read_of_a_compressed_log_that_is_cut_off_is_kept(
    suffix: str, tmp_path: Path
) -> None:
    path = write(tmp_path / f"bus{suffix}", FRAMES * 2000)
    compressed = gzip.compress(path.read_bytes())
    path.write_bytes(compressed[: len(compressed) // 2])
    log = open_log(path)
    assert 0 < len(list(log.frames())) < len(FRAMES) * 2000
    assert log.broken


def test_channels_are_told_apart(tmp_path: Path) -> None:
    other = can.Message(timestamp=START + 1, arbitration_id=1, channel=2, is_extended_id=False)
    path = write(tmp_path / "bus.blf", [*FRAMES, other])
    # the number in the file is one higher than python-can's
    with pytest.raises(DataError, match="holds frames of channels 2 and 3; say which one"):
        list(open_log(path).frames())
    log = open_log(path, "2")
    assert len(list(log.frames())) == len(FRAMES)
    assert log.others == 1


def test_what_was_read_of_a_damaged_log_is_kept(tmp_path: Path) -> None:
    path = write(tmp_path / "bus.csv", FRAMES)
    path.write_text(path.read_text() + "1700000001.0,0xZZ,0,0,0,1,AA==\n")
    log = open_log(path)
    assert len(list(log.frames())) == len(FRAMES)
    assert log.broken


def test_lines_that_python_can_skips_are_counted(tmp_path: Path) -> None:
    path = write(tmp_path / "bus.trc", FRAMES)
    path.write_text(path.read_text().replace(" DT ", " XX ", 2))
    log = open_log(path)
    assert len(list(log.frames())) == len(FRAMES) - 2
    assert log.events.total() == 2


TRC_1_0 = """;##########################################################################
;   Start time: {}
;---+--   ----+----  --+--  +  -+ -- -- -- -- -- -- --
     1)        10     0123  2  01 FF
     2)        20     0123  2  02 FF
"""


@pytest.mark.parametrize(
    ("start", "first", "clock"),
    [
        ("14.11.2023 22:13:20.500.0", START + 0.51, Clock.LOCAL),
        ("2023-11-14 22:13:20", START + 0.01, Clock.LOCAL),
        ("11/12/2023 22:13:20", 0.01, Clock.START),  # of November or December
        ("31.02.2023 22:13:20", 0.01, Clock.START),
    ],
)
def test_the_oldest_trc_counts_from_a_date_in_a_remark(
    start: str, first: float, clock: Clock, tmp_path: Path
) -> None:
    path = tmp_path / "bus.trc"
    path.write_text(TRC_1_0.format(start))
    log = open_log(path)
    assert [frame.stamp / 1e9 for frame in log.frames()] == pytest.approx([first, first + 0.01])
    assert log.stamps is clock


@pytest.mark.parametrize("zone", [None, ZoneInfo("Asia/Tokyo")])
def test_a_log_in_local_time_takes_a_zone(zone: ZoneInfo | None, tmp_path: Path) -> None:
    log = open_log(write(tmp_path / "bus.blf", FRAMES), zone=zone)
    (first, *_) = log.frames()
    assert log.stamps is (Clock.EPOCH if zone else Clock.LOCAL)
    assert first.stamp / 1e9 == pytest.approx(START - (9 * 3600 if zone else 0), abs=1e-3)


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        (b"", "the log is empty"),
        (b"\n \n", "the log is empty"),
        (b"time;id;data\n1;2;3\n", "not a log of a known format .*begins with 'time;id;data'"),
        (b"  can0  123   [2]  01 02\n", "shows on the screen.*record with candump -l"),
        (b" (12:01:02.5)  can0  18FEF100   [0]\n", "shows on the screen"),
        (b"LOGG" + b"\x00" * 300, "no frame could be read, as BLF"),
        (b"MDF     4.10    " + b"\x00" * 300, "MF4 needs asammdf, .*: pip install asammdf"),
    ],
)
def test_what_is_no_log_is_said_to_be_none(content: bytes, reason: str, tmp_path: Path) -> None:
    path = tmp_path / "bus.log"
    path.write_bytes(content)
    with pytest.raises(DataError, match=reason) as error:
        list(open_log(path).frames())
    assert "damaged" not in str(error.value)


def test_an_absent_log_is_named(tmp_path: Path) -> None:
    with pytest.raises(DataError, match="absent.blf: cannot be read: No such file"):
        open_log(tmp_path / "absent.blf")


def test_groups_that_the_dbc_does_not_say_are_reported(
    tmp_path: Path, write_dbc: Callable[..., Path], capsys: pytest.CaptureFixture[Any]
) -> None:
    path = write(tmp_path / "bus.blf", FRAMES)
    speed = ("Speed", "0|8@1+ (1,0) [0|0]", "rpm")
    dbc = write_dbc({"EEC1": (0x0CF004FE | 0x80000000, 3, 0, [speed])})
    out = tmp_path / "table.csv"
    assert main(["--dbc", str(dbc), "--log", str(path), "--out", str(out)]) == 0
    assert pl.read_csv(out)["value"].to_list() == [1.0, 3.0, 5.0, 7.0, 9.0]
    report = capsys.readouterr().out
    assert (
        "by group number (PGN) alone, as in J1939, which the DBC does not say: 0CF00400" in report
    )
