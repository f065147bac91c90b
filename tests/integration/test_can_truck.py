"""12 s of a heavy truck's J1939 bus through the decode command."""

from collections.abc import Iterator
from pathlib import Path

import can
import cantools.database
import polars as pl
import pytest

from crane_driver.can.dbc import load_dbc
from crane_driver.can.log_decoding import Cycle, cycles
from crane_driver.can.log_formats import CandumpLog, open_log
from crane_driver.can.log_table import LogTable
from crane_driver.decode import main

FRAMES, IDS = 9_950, 140
STAMP = "stamp"


@pytest.fixture(scope="module")
def log(real_data: Path) -> Path:
    (path,) = (real_data / "can_truck").glob("*.log")
    return path


@pytest.fixture(scope="module")
def dbc(real_data: Path) -> Path:
    return real_data / "can_truck" / "remora.dbc"


@pytest.fixture(scope="module")
def decoded(log: Path, dbc: Path) -> LogTable:
    table = LogTable(load_dbc(dbc))
    for frame in CandumpLog(log).frames():
        table.add(frame)
    return table


def groups_by_cantools(log: Path, dbc: Path) -> Iterator[tuple[can.Message, str, dict]]:
    """The same log through python-can's reader and cantools' own matching of J1939 groups."""
    database = cantools.database.Database(frame_id_mask=0x03FFFF00)
    database.add_dbc_file(dbc)
    for message in can.CanutilsLogReader(log):
        try:
            found = database.get_message_by_frame_id(message.arbitration_id, True)
        except KeyError:
            continue
        values = found.decode(message.data, decode_choices=False)
        labels = found.decode(message.data)
        missing = {signal for signal, label in labels.items() if str(label) == "notAvailable"}
        yield message, found.name, values | dict.fromkeys(missing)


def test_every_frame_is_decoded_or_counted(decoded: LogTable) -> None:
    assert decoded.frames == FRAMES
    assert not decoded.failed
    assert decoded.decoded + decoded.unknown.total() == FRAMES
    assert len(decoded.senders) + len(decoded.unknown) == IDS


def test_the_same_values_as_by_cantools_and_python_can(
    decoded: LogTable, log: Path, dbc: Path
) -> None:
    expected = [
        (message.timestamp, f"{message.arbitration_id:08X}", name, signal, value)
        for message, name, values in groups_by_cantools(log, dbc)
        for signal, value in values.items()
    ]
    table = decoded.table()
    assert len(table) == len(expected)
    seconds = table[STAMP].to_physical() / 1e9
    assert seconds.to_list() == pytest.approx([row[0] for row in expected], abs=1e-6)
    for column, place in (("id", 1), ("message", 2), ("signal", 3), ("value", 4)):
        assert table[column].to_list() == [row[place] for row in expected]


def test_the_engine_idles_at_600_rpm(decoded: LogTable) -> None:
    table = decoded.table()
    speed = table.filter((pl.col("signal") == "EngSpeed") & (pl.col("id") == "0CF00400"))
    assert len(speed) == 1205
    assert speed["in_range"].all()
    assert speed["unit"].unique().to_list() == ["rpm"]
    assert 598 <= speed["value"].min() <= speed["value"].max() <= 603.5


def test_what_a_device_does_not_have_is_not_taken_for_a_measurement(decoded: LogTable) -> None:
    """Source address 0x21 repeats the engine's message with all bits set: not available."""
    table = decoded.table()
    outside = table.filter(~pl.col("in_range"))
    assert len(outside) > 0
    raw = {"EngSpeed": 0xFFFF * 0.125, "WheelBasedVehicleSpeed": 0xFFFF * 0.00390625}
    for signal, value in raw.items():
        values = outside.filter(pl.col("signal") == signal)["value"]
        assert values.unique().to_list() == [value]


def test_cycle_times_are_those_of_the_standard(decoded: LogTable) -> None:
    """SAE J1939-71: EEC1 every 10 ms by the engine, EEC2 and EGF1 50 ms, CCVS and LFE 100 ms."""
    found: dict[str, Cycle] = {one.id: one for one in cycles(decoded)}
    for identifier, cycle in (
        ("0CF00400", 0.01),
        ("0CF00300", 0.05),
        ("0CF00A01", 0.05),
        ("18FEF100", 0.1),
        ("18FEF200", 0.1),
        ("18FEF600", 0.5),
    ):
        assert found[identifier].median == pytest.approx(cycle, rel=0.02), identifier
        assert found[identifier].gaps == 0


def test_lost_frames_show_as_a_gap(log: Path, dbc: Path) -> None:
    table = LogTable(load_dbc(dbc))
    engine = 0
    for frame in CandumpLog(log).frames():
        engine += frame.id == 0x0CF00400
        if not (frame.id == 0x0CF00400 and 400 < engine <= 420):
            table.add(frame)
    assert table.frames == FRAMES - 20
    (gap,) = [one for one in cycles(table) if one.gaps]
    assert (gap.message, gap.frames, gap.gaps) == ("EEC1", 1185, 1)
    assert gap.longest_gap == pytest.approx(0.21, abs=0.01)
    assert gap.longest_gap_at == pytest.approx(4.0, abs=0.1)


def test_the_command_writes_the_table_and_reports(
    log: Path, dbc: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "truck.parquet"
    assert main(["--dbc", str(dbc), "--log", str(log), "--out", str(out)]) == 0
    report = capsys.readouterr().out
    assert f"{FRAMES} frames read over 12.0" in report
    assert "unknown ids: " in report
    table = pl.read_parquet(out)
    assert table[STAMP].is_sorted()
    assert table[STAMP].dtype == pl.Datetime("ns", "UTC")


def test_a_dbc_that_does_not_say_j1939_gives_the_same_values(
    decoded: LogTable, log: Path, dbc: Path, tmp_path: Path
) -> None:
    silent = tmp_path / "silent.dbc"
    kept = [line for line in dbc.read_text().splitlines() if '"VFrameFormat"' not in line]
    silent.write_text("\n".join(kept))
    table = LogTable(load_dbc(silent))
    for frame in CandumpLog(log).frames():
        table.add(frame)
    assert table.table().equals(decoded.table())


def test_other_formats_of_the_same_log(log: Path, tmp_path: Path) -> None:
    """BLF keeps 10 ns, ASC 1 µs."""
    path = tmp_path / "truck.blf"
    frames = list(CandumpLog(log).frames())
    with can.Logger(path) as writer:
        for message in can.CanutilsLogReader(log):
            writer.on_message_received(message)
    same = list(open_log(path).frames())
    assert [(one.id, one.data) for one in same] == [(one.id, one.data) for one in frames]
    assert max(abs(a.stamp - b.stamp) for a, b in zip(same, frames, strict=True)) < 1_000_000
