"""J1939: who sends a message, and which values are no measurements, for tables, bags and driver."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest

from crane_bags import read_topics
from crane_bags.types import CYLINDER_PRESSURES, JOINT_STATES
from crane_driver import DriverCodec, FaultKind, load_layout
from crane_driver.can.codec import Readings
from crane_driver.can.frame import Frame
from crane_driver.can.health import ForeignCommands
from crane_driver.decode import main
from crane_model import load_machine

WriteDbc = Callable[..., Path]
WriteMapping = Callable[[dict[str, Any]], Path]
EXTENDED = 0x80000000
OTHERS = 12  # frames: more than a second


def messages(source: int, limits: str = "[0|0]") -> dict[str, Any]:
    angle = ("Angle", "0|16@1- (0.01,0) [0|0]", "deg")
    pressure = ("Chamber", f"16|16@1+ (1000,0) {limits}", "Pa")
    return {
        "Boom": (0x18FF0100 | source | EXTENDED, 6, 10, [
            angle, pressure, ("Ready", "32|2@1+ (1,0) [0|0]", ""),
        ]),
        "Valve": (0x110, 2, 10, [("Spool", "0|16@1- (0.01,0) [0|0]", "%")]),
    }  # fmt: skip


MAPPING = {
    "positions": {"inner_boom": {"signal": "Boom.Angle", "unit": "°"}},
    "pressures": {"inner_boom.a": {"signal": "Boom.Chamber", "unit": "Pa"}},
    "commands": {"inner_boom": {"signal": "Valve.Spool", "unit": "%"}},
    "timing": {"late": 10, "missing": 20, "lost": 2},
}


def line(number: int, source: int, angle: int = 0, pressure: int = 5000, ready: int = 1) -> str:
    data = angle.to_bytes(2, "little") + pressure.to_bytes(2, "little") + bytes((ready, 0))
    return f"({1_700_000_000 + 0.01 * number:.6f}) can0 18FF01{source:02X}#{data.hex().upper()}\n"


@pytest.fixture
def decode(
    tmp_path: Path,
    write_dbc: WriteDbc,
    write_mapping: WriteMapping,
    capsys: pytest.CaptureFixture[str],
) -> Callable[..., tuple[int, str, Path]]:
    """Run the command: status, what it said, and the table or bag."""

    def run(
        lines: str, dbc: dict[str, Any], *options: str, bag: bool = False, **mapping: Any
    ) -> Any:
        log, out = tmp_path / "bus.log", tmp_path / ("bag" if bag else "table.parquet")
        log.write_text(lines)
        arguments = ["--log", str(log), "--dbc", str(write_dbc(dbc)), "--out", str(out), *options]
        if bag:
            arguments += ["--mapping", str(write_mapping({**MAPPING, **mapping}))]
        status = main(arguments)
        said = capsys.readouterr()
        return status, said.out + said.err, out

    return run


def test_a_placeholder_stands_for_the_one_device_that_sends(decode: Any) -> None:
    log = "".join(line(number, 0x21, number) for number in range(OTHERS))
    status, said, bag = decode(log, messages(0xFE), bag=True)
    assert status == 0, said
    states = read_topics(bag, (JOINT_STATES,))[JOINT_STATES.name]
    assert len(states.stamp) == OTHERS
    assert "no frame of Valve (110) is in the log" in said


def test_two_devices_are_not_one_reading(decode: Any) -> None:
    log = "".join(line(number, 0x21 + number % 2) for number in range(OTHERS))
    status, said, bag = decode(log, messages(0xFE), bag=True)
    assert status == 1
    assert "message Boom: 18FF0121 and 18FF0122 both send it, and the DBC names neither" in said
    assert not bag.exists()


def test_what_is_in_the_table_and_not_in_the_bag_is_said(decode: Any) -> None:
    log = "".join(line(number, 0x21 + number % 2) for number in range(OTHERS))
    status, said, bag = decode(log, messages(0x21), bag=True)
    assert status == 0
    assert "Boom comes from 18FF0121, 18FF0122, and the bag takes it from 18FF0121 only" in said
    assert len(read_topics(bag, (JOINT_STATES,))[JOINT_STATES.name].stamp) == OTHERS // 2
    status, said, _ = decode(log.replace("FF0121", "FF0123"), messages(0x21), bag=True)
    assert status == 1


def test_the_driver_takes_one_device_and_says_that_there_is_another(
    write_dbc: WriteDbc, write_mapping: WriteMapping
) -> None:
    layout = load_layout(load_machine(), write_mapping(MAPPING), write_dbc(messages(0xFE)))
    driver = DriverCodec(layout)
    assert not layout.frames_of_cycle, "no identifier is waited for that never comes"

    def read(source: int) -> Readings:
        readings = driver.decode(Frame(0x18FF0100 | source, bytes(6), True, 0, 0.0))
        assert readings is not None
        return readings

    assert read(0x21).positions == {"inner_boom": 0.0}
    second = read(0x22)
    assert not second.positions
    (fault,) = second.faults
    assert fault.kind is FaultKind.REPEATED
    assert "18FF0121 and 18FF0122 both send it" in fault.detail
    assert read(0x21).positions, "the first one goes on"


def test_a_valve_command_from_any_source_address_is_foreign(
    write_dbc: WriteDbc, write_mapping: WriteMapping
) -> None:
    dbc = messages(0x21)
    dbc["Valve"] = (0x18FF02FE | EXTENDED, *dbc["Valve"][1:])
    foreign = ForeignCommands(load_layout(load_machine(), write_mapping(MAPPING), write_dbc(dbc)))
    fault = foreign.observe(Frame(0x18FF0227, b"\x88\x13", True))
    assert fault is not None
    assert fault.kind is FaultKind.FOREIGN
    assert "inner_boom 0.5" in fault.detail
    assert foreign.observe(Frame(0x18FF0327, bytes(2), True)) is None


CODES = "".join(
    [
        line(0, 0x21, pressure=0xFAFF),
        line(1, 0x21, pressure=0xFB00),
        line(2, 0x21, pressure=0xFE00),
        line(3, 0x21, pressure=0xFFFF, ready=3),
    ]
)


@pytest.mark.parametrize("limits", ["[0|0]", "[0|65535000]"])  # what the bits hold says nothing
def test_codes_are_no_values_of_a_table(decode: Any, limits: str) -> None:
    status, said, out = decode(CODES, messages(0xFE, limits))
    assert status == 0
    table = pl.read_parquet(out)
    chamber = table.filter(signal="Chamber")
    assert chamber["value"].to_list() == [0xFAFF * 1000.0, None, None, None]
    assert chamber["in_range"].to_list() == [True, False, False, False]
    assert table.filter(signal="Ready")["value"].to_list() == [1.0, 1.0, 1.0, None]
    for counted in ("reserved", "error", "not available"):
        assert f"Boom.Chamber: 1 x {counted}" in said
    assert "Boom.Ready: 1 x not available" in said


def test_four_bits_have_a_code_too(decode: Any) -> None:
    dbc = messages(0xFE)
    dbc["Boom"][3][2] = ("Ready", "32|4@1+ (1,0) [0|0]", "")
    status, said, out = decode("".join(line(k, 0x21, ready=13 + k) for k in range(3)), dbc)
    assert status == 0
    assert pl.read_parquet(out).filter(signal="Ready")["value"].to_list() == [13.0, 14.0, None]
    assert "Boom.Ready: 1 x not available" in said


def test_codes_are_kept_where_they_are_wanted_or_the_dbc_knows_better(decode: Any) -> None:
    _, said, out = decode(CODES, messages(0xFE), "--keep-codes")
    assert pl.read_parquet(out).filter(signal="Chamber")["value"].max() == 0xFFFF * 1000.0
    assert "not measurements" not in said
    _, said, out = decode(CODES, messages(0xFE, "[0|64600000]"), "--replace")
    chamber = pl.read_parquet(out).filter(signal="Chamber")
    assert chamber["value"].max() == 0xFFFF * 1000.0
    assert chamber["in_range"].to_list() == [True, True, False, False], "as the DBC says"
    standard = messages(0xFE)
    standard["Boom"] = (0x101, *standard["Boom"][1:])
    _, said, out = decode(CODES.replace("18FF0121", "101"), standard, "--replace")
    assert pl.read_parquet(out).filter(signal="Chamber")["value"].max() == 0xFFFF * 1000.0


def test_codes_are_no_readings_of_a_bag(decode: Any) -> None:
    status, said, bag = decode(CODES, messages(0xFE), bag=True)
    assert status == 0
    pressures = read_topics(bag, (CYLINDER_PRESSURES,))[CYLINDER_PRESSURES.name]
    assert np.nanmax(pressures.fields["chamber_a"]) == 0xFAFF * 1000.0
    assert "Boom: 3 x sensor" in said


def test_codes_of_a_bag_are_kept_by_the_mapping(decode: Any) -> None:
    _, said, bag = decode(CODES, messages(0xFE), bag=True, codes="none")
    assert "not measurements" not in said
    pressures = read_topics(bag, (CYLINDER_PRESSURES,))[CYLINDER_PRESSURES.name]
    assert pressures.fields["chamber_a"].max() == 0xFFFF * 1000.0


LABELS = (
    'VAL_ 257 Chamber 65535 "SNA" 65534 "Sensor_Error" 65533 "Full" ;\n'
    'VAL_ 257 Ready 2 "Error" 3 "Not available" ;\n'
)


@pytest.fixture
def labelled(write_dbc: WriteDbc) -> Path:
    """A DBC of standard identifiers whose value tables name codes."""
    standard = messages(0xFE)
    standard["Boom"] = (0x101, *standard["Boom"][1:])
    path = write_dbc(standard)
    path.write_text(path.read_text() + LABELS)
    return path


def test_a_code_that_the_value_table_names_is_no_measurement(
    labelled: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log, out = tmp_path / "bus.log", tmp_path / "table.parquet"
    lines = [line(k, 0x21, pressure=0xFFFF - k, ready=3) for k in range(3)]
    log.write_text("".join(lines).replace("18FF0121", "101"))
    assert main(["--log", str(log), "--dbc", str(labelled), "--out", str(out)]) == 0
    table = pl.read_parquet(out)
    assert table.filter(signal="Chamber")["value"].to_list() == [None, None, 0xFFFD * 1000.0]
    assert table.filter(signal="Ready")["value"].to_list() == [3.0, 3.0, 3.0], "states are numbers"
    said = capsys.readouterr().out
    assert "Boom.Chamber: 1 x not available, Boom.Chamber: 1 x error" in said


def test_the_driver_takes_no_code_of_a_value_table_for_a_pressure(
    labelled: Path, write_mapping: WriteMapping
) -> None:
    driver = DriverCodec(load_layout(load_machine(), write_mapping(MAPPING), labelled))
    readings = driver.decode(Frame(0x101, b"\0\0\xff\xff\0\0"))
    assert readings is not None
    assert not readings.pressures
    assert readings.faults[0].detail == (
        "inner_boom.a: Chamber is 0xFFFF, which means not available"
    )


def test_a_code_that_the_value_table_names_too_is_still_one_of_j1939(
    decode: Any, write_dbc: WriteDbc
) -> None:
    dbc = messages(0xFE)
    _, _, out = decode(CODES, dbc)
    path = write_dbc(dbc)
    path.write_text(path.read_text() + f'VAL_ {dbc["Boom"][0]} Chamber 65535 "NotAvailable";\n')
    options = ["--log", str(out.parent / "bus.log"), "--dbc", str(path), "--out", str(out)]
    assert main([*options, "--replace"]) == 0
    chamber = pl.read_parquet(out).filter(signal="Chamber")
    assert chamber["value"].to_list() == [0xFAFF * 1000.0, None, None, None]


def test_no_number_of_a_float_signal_is_a_fault_and_no_code(
    write_dbc: WriteDbc, write_mapping: WriteMapping
) -> None:
    dbc = messages(0x21)
    dbc["Boom"] = (0x101, 8, 10, [
        ("Angle", "0|16@1- (0.01,0) [0|0]", "deg"), ("Chamber", "32|32@1- (1,0) [0|0]", "Pa"),
    ])  # fmt: skip
    path = write_dbc(dbc)
    path.write_text(path.read_text() + "SIG_VALTYPE_ 257 Chamber : 1;\n")
    driver = DriverCodec(load_layout(load_machine(), write_mapping(MAPPING), path))
    readings = driver.decode(Frame(0x101, bytes(4) + np.float32(np.nan).tobytes()))
    assert readings is not None
    assert not readings.pressures
    assert [fault.kind for fault in readings.faults] == [FaultKind.OUT_OF_RANGE]
