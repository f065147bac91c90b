"""ASC logs: what the file says decides, and what cannot be read is counted by kind."""

from collections.abc import Callable
from datetime import UTC, datetime, timedelta, timezone
from pathlib import Path
from zoneinfo import ZoneInfo

import polars as pl
import pytest

from crane_driver.can.bus_log import BusLog, Clock
from crane_driver.can.frame import Frame
from crane_driver.can.log_formats import open_log
from crane_driver.decode import main
from crane_model import DataError

DATE = "Tue Jul 1 03:04:05.250 pm 2025"
START = datetime(2025, 7, 1, 15, 4, 5, 250_000, UTC)


def header(stamps: str = "absolute", base: str = "hex", date: str = DATE) -> str:
    return (
        f"date {date}\nbase {base}  timestamps {stamps}\ninternal events logged\n"
        f"// version 9.0.0\nBegin Triggerblock {date}\n"
    )


def frame(time: float, value: int = 1, channel: int = 1) -> str:
    return (
        f"   {time:.6f} {channel}  1A0             Rx   d 2 {value:02X} FF  Length = 1 ID = 416\n"
    )


def read(
    tmp_path: Path, text: str, channel: str | None = None, zone: ZoneInfo | None = None
) -> tuple[BusLog, list[Frame]]:
    path = tmp_path / "bus.asc"
    path.write_bytes(text.encode("cp1252"))
    log = open_log(path, channel, zone)
    return log, list(log.frames())


def since(frames: list[Frame], start: datetime = START) -> list[float]:
    return [one.stamp / 1e9 - start.timestamp() for one in frames]


def test_relative_stamps_add_up_over_lines_of_every_kind(tmp_path: Path) -> None:
    text = header("relative") + frame(0.5) + "   0.250000 1  Statistic: D 1 R 0\n" + frame(0.25)
    _, frames = read(tmp_path, text)
    assert since(frames) == pytest.approx([0.5, 1.0], abs=1e-6)


def test_the_header_may_have_a_line_for_each_word(tmp_path: Path) -> None:
    text = f"date {DATE}\nbase dec\ntimestamps relative\nno internal events logged\n"
    log, (first, second) = read(
        tmp_path, text + frame(0.5).replace("1A0", "416").replace("FF", "255") * 2
    )
    assert (first.id, second.stamp - first.stamp, log.damaged) == (416, 500_000_000, 0)


def test_a_damaged_stamp_among_relative_ones_is_said(tmp_path: Path) -> None:
    log, frames = read(tmp_path, header("relative") + frame(0.5) + "0.2x 1 1A0 Rx\n" + frame(0.25))
    assert (len(frames), log.damaged, log.lost_steps) == (2, 1, 1)


def test_stamps_of_later_blocks_go_on_or_begin_anew(tmp_path: Path) -> None:
    goes_on = f"Begin Triggerblock {DATE.replace('03:04', '03:06')}\n" + frame(120.5)
    _, frames = read(tmp_path, header() + frame(1.0) + "End TriggerBlock\n" + goes_on)
    assert since(frames) == pytest.approx([1.0, 120.5], abs=1e-6)
    anew = goes_on.replace("120.5", "0.5")
    _, frames = read(tmp_path, header() + frame(1.0) + "End TriggerBlock\n" + anew)
    assert since(frames) == pytest.approx([1.0, 120.5], abs=1e-6)


@pytest.mark.parametrize("encoding", ["utf-16", "utf-16-be"])
def test_a_log_in_utf_16_is_read(encoding: str, tmp_path: Path) -> None:
    path = tmp_path / "bus.asc"
    path.write_bytes((header() + frame(1.0)).encode(encoding))
    log = open_log(path)
    assert since(list(log.frames())) == pytest.approx([1.0], abs=1e-6)
    assert log.damaged == 0


def test_channels_have_the_numbers_of_the_file(tmp_path: Path) -> None:
    text = header() + frame(0.0, 1, channel=1) + frame(0.1, 2, channel=2) + frame(0.2, 7, channel=7)
    with pytest.raises(DataError, match="frames of channels 1, 2 and 7; say which one to read"):
        read(tmp_path, text)
    log, (found,) = read(tmp_path, text, "2")
    assert found.data[0] == 2
    assert log.others == 2


def test_a_channel_that_is_absent_is_answered_by_those_that_are_there(
    tmp_path: Path, write_dbc: Callable[..., Path], capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "bus.asc"
    path.write_text(header() + frame(0.0, channel=3) + frame(0.1, channel=4))
    dbc = write_dbc({"Boom": (0x1A0, 2, 0, [("Angle", "0|8@1+ (1,0) [0|0]", "")])})
    table = str(tmp_path / "out.csv")
    assert main(["--log", str(path), "--dbc", str(dbc), "--out", table, "--channel", "1"]) == 1
    assert "no data frame of channel 1" in (said := capsys.readouterr().err)
    assert "name one of its channels: 3, 4" in said


def test_lines_that_are_no_frames_are_counted_by_kind(tmp_path: Path) -> None:
    text = (
        header()
        + "   0.000000 Start of measurement\n"
        + "   0.015991 CAN 1 Status:chip status error passive - TxErr: 132 RxErr: 0\n"
        + "   1.015991 1  Statistic: D 0 R 0 XD 0 XR 0 E 0 O 0 B 0.00%\n"
        + "   1.100000 1  J1939TP FEE3p        6    0  0   -   Rx   d 23 A0 0F\n"
        + "// a remark\n"
        + "   1.200000 1  1A0  TxRq d 1 00\n"
        + "   1.200100 1  1A0  Tx   d 1 00\n"
        + "   1.300000 1  EngineData  Rx d 8 00 00 00 00 00 00 00 00\n"
        + "   1.400000 1  ErrorFrame ECC: 10100010\n"
        + "   1.500000 1  1A0  Rx   r 8\n"
        + "   1.600000 \n"
        + "   1.610000 1 \n"  # damaged from here on
        + "   1.6x0000 1  1A0  Rx d 1 00\n"
        + "   1.620000 1  1G0  Rx d 1 00\n"
        + "   1.630000 1  1A0  Rx d 8 00 11\n"
        + "\x00\x00\x00\n"
        + "End TriggerBlock\n"
    )
    log, frames = read(tmp_path, text)
    assert [one.data for one in frames] == [b"\0"]
    assert (log.errors, log.remote, log.damaged) == (1, 1, 6)
    assert dict(log.events) == {
        "lines of other events": 1,
        "status lines": 1,
        "statistic lines": 1,
        "lines of the J1939 transport protocol": 1,
        "requests to transmit": 1,
        "frames with a name in the place of the identifier": 1,
    }


def test_frames_of_every_kind_are_read(tmp_path: Path) -> None:
    text = (
        header()
        + "   0.1 1  18FEF121x       Rx   d 3 01 02 FF  Length = 1 BitCount = 2 ID = 4x\n"
        + "   0.2 1  18FEF121        Tx   d 0\n"  # without x: too large to be a standard one
        + "   0.3 1  3FF             Tx   d D 55 AA 01 02 03 04 05 06\n"
        + "   0.4 CANFD   1 Rx        7d  Brake_4                          1 0 9 12 "
        + "01 02 03 04 05 06 07 08 09 0a 0b 0c   104812  132   323000 a800f6c9\n"
        + "   0.5 CANFD   1 Rx        167x                                 0 1 1  1 0a 105 2\n"
        + "   0.6 CANFD 1  101             Tx   1 0 d 2 2 F1 F2  Length = 209000\n"
    )
    _, frames = read(tmp_path, text)
    assert [(one.id, one.extended, one.data.hex()) for one in frames] == [
        (0x18FEF121, True, "0102ff"),
        (0x18FEF121, True, ""),
        (0x3FF, False, "55aa010203040506"),
        (0x7D, False, "0102030405060708090a0b0c"),
        (0x167, True, "0a"),
        (0x101, False, "f1f2"),
    ]


def test_decimal_numbers_are_read_as_the_header_says(tmp_path: Path) -> None:
    _, (found,) = read(tmp_path, header(base="dec") + "  0.1 1  416  Rx  d 3 10 255 0\n")
    assert (found.id, found.data) == (416, bytes((10, 255, 0)))


@pytest.mark.parametrize(
    ("date", "expected"),
    [
        (DATE, START),
        ("Mit Okt 8 15:04:05 2025", datetime(2025, 10, 8, 15, 4, 5, 0, UTC)),
        ("Mon Mär 3 15:04:05.25 2025", datetime(2025, 3, 3, 15, 4, 5, 250_000, UTC)),
        ("Mon Dez 29 12:00:00.5 am 2025", datetime(2025, 12, 29, 0, 0, 0, 500_000, UTC)),
    ],
)
def test_dates_of_either_language(date: str, expected: datetime, tmp_path: Path) -> None:
    _, frames = read(tmp_path, header(date=date) + frame(1.0))
    assert since(frames, expected) == pytest.approx([1.0], abs=1e-6)


@pytest.mark.parametrize("computer", ["UTC", "Asia/Tokyo"])
@pytest.mark.parametrize("zone", [None, "Europe/Berlin"])
def test_stamps_do_not_depend_on_the_computer_that_reads(
    computer: str, zone: str | None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("TZ", computer)
    log, frames = read(tmp_path, header() + frame(1.0), zone=ZoneInfo(zone) if zone else None)
    start = START.replace(tzinfo=timezone(timedelta(hours=2))) if zone else START
    assert since(frames, start) == pytest.approx([1.0], abs=1e-6)
    assert log.stamps is (Clock.EPOCH if zone else Clock.LOCAL)


@pytest.mark.parametrize(
    ("lines", "column", "first", "said"),
    [
        (header(), "stamp", "2025-07-01T15:04:05.500000000", "does not state its zone"),
        ("base hex  timestamps absolute\n", "time", "0.25", "states no date"),
        ("date whenever\nbase hex  timestamps absolute\n", "time", "0.25", "1 dates that cannot"),
        ("", "time", "0.25", "states no date"),
    ],
)
def test_a_table_says_what_its_stamps_are(
    lines: str,
    column: str,
    first: str,
    said: str,
    tmp_path: Path,
    write_dbc: Callable[..., Path],
    capsys: pytest.CaptureFixture[str],
) -> None:
    path, out = tmp_path / "bus.asc", tmp_path / "table.csv"
    path.write_text(lines + frame(0.25) + frame(0.5))
    dbc = write_dbc({"Boom": (0x1A0, 2, 0, [("Angle", "0|8@1+ (1,0) [0|0]", "")])})
    assert main(["--log", str(path), "--dbc", str(dbc), "--out", str(out)]) == 0
    table = pl.read_csv(out, infer_schema=False)
    assert table.columns[0] == column
    assert table[column].to_list()[0] == first, "and no frame in front of a block is lost"
    assert said in (report := capsys.readouterr().out)
    assert "2 frames read over 0.250 s" in report


def test_a_zone_of_a_log_in_utc_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "bus.log"
    path.write_text("(1700000000.0) can0 123#11\n")
    arguments = ["--log", str(path), "--out", str(tmp_path / "out.csv"), "--zone", "Europe/Berlin"]
    assert main(arguments) == 1
    assert "this one holds UTC" in capsys.readouterr().err
