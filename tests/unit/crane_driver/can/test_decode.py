"""The decode command: a log of the laboratory crane to a table and to a bag."""

import math
import re
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import polars as pl
import pytest

from crane_bags import read_topics
from crane_bags.types import CYLINDER_PRESSURES, JOINT_STATES, VALVE_COMMAND
from crane_driver import DriverCodec, MachineCodec
from crane_driver.can.frame import Frame, show_id
from crane_driver.can.layout import Layout
from crane_driver.decode import main
from crane_model.machine_files import machine_file

DBC = machine_file("can.dbc")
MAPPING = machine_file("can.yaml")
START = 1_700_000_000
CYCLES = 40


def line(frame: Frame, time: float) -> str:
    seconds = f"{START + time:.6f}"
    return f"({seconds}) can0 {show_id(frame.id, frame.extended)}#{frame.data.hex().upper()}"


@pytest.fixture
def crane_log(tmp_path: Path, crane: Layout) -> Path:
    """40 cycles: the telescope moves by 1 mm a cycle; the valves are enabled in the second half;
    cycle 10 lacks one encoder frame, cycle 20 has a damaged one.
    """
    machine, driver = MachineCodec(crane), DriverCodec(crane)
    lines = []
    for cycle in range(CYCLES):
        now = 0.005 * cycle
        positions = {"slew": 0.0, "inner_boom": 0.5, "outer_boom": -1.0, "telescope": cycle * 1e-3}
        pressures = dict.fromkeys(crane.pressures, 5e6)
        (command,) = driver.command_frames({"telescope": 0.25}, enabled=cycle >= CYCLES // 2)
        lines.append(line(command, now))
        for number, message in enumerate(machine.cycles):
            states = {"valve_unit": "Enabled"}
            frame = machine.reading_frame(message, positions, pressures, states)
            if cycle == 10 and message == "EncoderBase":
                continue
            if cycle == 20 and message == "EncoderBoom":
                frame = frame._replace(data=frame.data[:7] + bytes((frame.data[7] ^ 4,)))
            lines.append(line(frame, now + 0.0002 * (number + 1)))
    path = tmp_path / "crane.log"
    path.write_text("\n".join(lines))
    return path


@pytest.mark.parametrize("suffix", [".csv", ".parquet"])
def test_every_value_of_the_log_is_in_the_table(
    crane_log: Path, tmp_path: Path, suffix: str, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / f"crane{suffix}"
    assert main(["--dbc", str(DBC), "--log", str(crane_log), "--out", str(out)]) == 0
    table = pl.read_csv(out) if suffix == ".csv" else pl.read_parquet(out)
    assert table.columns == ["stamp", "id", "message", "signal", "value", "unit", "in_range"]
    telescope = table.filter(pl.col("signal") == "TelescopePosition")
    sound = [cycle for cycle in range(CYCLES) if cycle != 20]
    assert telescope["value"].gather(sound).to_list() == pytest.approx([n * 1e-3 for n in sound])
    assert set(telescope["unit"]) == {"m"}
    assert set(telescope["id"].cast(pl.String)) == {"121"}
    outside = table.filter(~pl.col("in_range"))
    assert outside["signal"].to_list() == ["TelescopePosition"], "the DBC knows no checksums"
    report = capsys.readouterr().out
    assert main(["--dbc", str(DBC), "--log", str(crane_log), "--out", str(out)]) == 1
    assert "exists; name another place, or --replace" in capsys.readouterr().err
    assert "239 frames read over 0.196 s: 239 decoded, 0 of 0 unknown ids" in report


@pytest.mark.parametrize("bag", [True, False])
@pytest.mark.parametrize(
    ("frame", "reason"),
    [
        ("121#0102", "2 frames of EncoderBoom (121): 2 bytes, the DBC says 8"),
        ("7A1#0102030405060708", "unknown id 7A1: 2"),
    ],
)
def test_a_log_of_which_nothing_can_be_decoded_is_refused(
    frame: str, reason: str, bag: bool, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log, out = tmp_path / "bus.log", tmp_path / ("bag" if bag else "table.csv")
    log.write_text("".join(f"({START}.{k:06}) can0 {frame}\n" for k in range(2)))
    mapping = ["--mapping", str(MAPPING)] if bag else []
    assert main(["--dbc", str(DBC), *mapping, "--log", str(log), "--out", str(out)]) == 1
    error = capsys.readouterr().err
    assert f"none of 2 frames can be decoded by the DBC: {reason}; name the DBC of this" in error
    assert not out.exists()


def test_frames_of_another_size_are_in_the_log_and_not_in_the_bag(
    crane_log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    crane_log.write_text(re.sub("(121#.*)..", r"\1", crane_log.read_text()))
    arguments = ["--dbc", str(DBC), "--mapping", str(MAPPING), "--out", str(tmp_path / "bag")]
    main([*arguments, "--log", str(crane_log)])
    said = capsys.readouterr()
    assert "frames of EncoderBoom (121): 7 bytes, the DBC says 8" in said.err + said.out
    assert "no frame of" not in said.err + said.out


def test_stamps_of_the_table_are_those_of_the_log(crane_log: Path, tmp_path: Path) -> None:
    out = tmp_path / "crane.parquet"
    main(["--dbc", str(DBC), "--log", str(crane_log), "--out", str(out)])
    stamps = pl.read_parquet(out).filter(pl.col("signal") == "SlewSpool")["stamp"]
    expected = START * 10**9 + 5_000_000 * np.arange(CYCLES)
    assert stamps.to_physical().to_list() == expected.tolist()


def test_the_bag_holds_the_topics_of_the_driver(
    crane_log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "bag"
    arguments = ["--dbc", str(DBC), "--log", str(crane_log), "--mapping", str(MAPPING)]
    assert main([*arguments, "--out", str(out)]) == 0
    topics = read_topics(out, (JOINT_STATES, CYLINDER_PRESSURES, VALVE_COMMAND))

    states = topics[JOINT_STATES.name]
    whole = [cycle for cycle in range(CYCLES) if cycle not in (10, 20)]
    telescope = states.fields["position"][:, states.names.index("telescope")]
    assert telescope == pytest.approx(np.array(whole) * 1e-3)
    assert states.stamp.tolist() == [START * 10**9 + 5_000_000 * cycle + 200_000 for cycle in whole]
    assert np.isnan(states.fields["velocity"]).all(), "a velocity is not measured"

    pressures = topics[CYLINDER_PRESSURES.name]
    assert pressures.names == ("inner_boom", "outer_boom", "telescope")
    assert pressures.fields["chamber_a"] == pytest.approx(np.full((CYCLES, 3), 5e6), abs=3100)
    assert pressures.fields["tank"] == pytest.approx(np.full(CYCLES, 5e6), abs=3100)

    command = topics[VALVE_COMMAND.name]
    telescope = command.fields["command"][:, command.names.index("telescope")]
    assert telescope.tolist() == [0.0] * (CYCLES // 2) + [0.25] * (CYCLES // 2)

    report = capsys.readouterr().out
    assert f"{out}: /joint_states: 38 messages" in report
    assert "EncoderBoom: 1 x checksum" in report
    assert "2 cycles left out" in report


def test_polars_is_needed_for_tables_alone(
    crane_log: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setitem(sys.modules, "polars", None)
    arguments = ["--dbc", str(DBC), "--log", str(crane_log), "--mapping", str(MAPPING)]
    assert main([*arguments, "--out", str(tmp_path / "bag")]) == 0
    capsys.readouterr()
    assert main([*arguments, "--out", str(tmp_path / "crane.csv")]) == 1
    assert "polars is not installed" in (said := capsys.readouterr().err)
    assert "install it by: make tables" in said


def shifted(crane_log: Path, by: Callable[[int], float]) -> Path:
    """The log with `by` [s] added to the stamp of each of its lines."""
    lines = []
    for number, text in enumerate(crane_log.read_text().splitlines()):
        stamp, rest = text[1:].split(")", 1)
        lines.append(f"({float(stamp) + by(number):.6f}){rest}")
    path = crane_log.with_name("shifted.log")
    path.write_text("\n".join(lines))
    return path


@pytest.mark.parametrize("by", [-0.15, -0.4, -3600.0])
def test_a_clock_that_is_set_back_costs_no_messages(
    by: float, crane_log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Cycles begin anew behind the step; half of them were left out as incomplete."""
    log, out = shifted(crane_log, lambda number: by if number > 180 else 0.0), tmp_path / "bag"
    arguments = ["--dbc", str(DBC), "--log", str(log), "--mapping", str(MAPPING)]
    assert main([*arguments, "--out", str(out)]) == 0
    report = capsys.readouterr().out
    assert f"time goes back 1 times, by up to {abs(by):.3g}"[:-1] in report
    stamps = re.findall(r"^\((.*?)\)", crane_log.read_text(), re.MULTILINE)
    lasted = re.search(r"frames read over (\S+) s", report)
    assert lasted
    assert float(lasted[1]) == pytest.approx(float(stamps[-1]) - float(stamps[0]), abs=0.01)
    counted = re.search("/joint_states: ([0-9]+) messages", report)
    assert counted and int(counted[1]) >= 36


@pytest.mark.parametrize(
    ("by", "times"),
    [
        pytest.param(lambda number: -0.003 * (number // 20), 10, id="by 3 ms, for good"),
        pytest.param(lambda number: -0.5 * (number % 20 == 10), 12, id="by 0.5 s, for one frame"),
    ],
)
def test_a_log_whose_clock_goes_back_again_and_again_makes_no_bag(
    by: Callable[[int], float],
    times: int,
    crane_log: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    log = shifted(crane_log, by)
    arguments = ["--dbc", str(DBC), "--log", str(log), "--mapping", str(MAPPING)]
    assert main([*arguments, "--out", str(tmp_path / "bag")]) == 1
    assert f"time goes back {times} times, by up to 0." in capsys.readouterr().err
    assert not (tmp_path / "bag").exists()


def test_a_bag_needs_a_mapping(
    crane_log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "bag"
    assert main(["--dbc", str(DBC), "--log", str(crane_log), "--out", str(out)]) == 1
    assert "a bag needs --mapping" in capsys.readouterr().err
    assert not out.exists()


def test_an_existing_bag_stays_as_it_is(crane_log: Path, tmp_path: Path) -> None:
    out = tmp_path / "bag"
    out.mkdir()
    (out / "kept").touch()
    arguments = ["--dbc", str(DBC), "--log", str(crane_log), "--mapping", str(MAPPING)]
    assert main([*arguments, "--out", str(out)]) == 1
    assert (out / "kept").exists()


@pytest.mark.parametrize(
    ("content", "reason"),
    [("", "the log is empty"), ("(1.0) can0 7FF#00\n", "none of 1 frames can be decoded")],
)
def test_a_log_of_nothing_leaves_no_bag(
    tmp_path: Path, content: str, reason: str, capsys: pytest.CaptureFixture[str]
) -> None:
    log = tmp_path / "other.log"
    log.write_text(content)
    out = tmp_path / "bag"
    arguments = ["--dbc", str(DBC), "--log", str(log), "--mapping", str(MAPPING)]
    assert main([*arguments, "--out", str(out)]) == 1
    assert reason in capsys.readouterr().err
    assert not out.exists()


def test_what_cannot_be_decoded_is_counted_and_out_of_range_is_marked(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log = tmp_path / "odd.log"
    log.write_text(
        "(10.0) can0 120#0000000000000080\n"  # inner boom beyond its range
        "(10.1) can0 120#00\n"
        "(10.2) can0 7FF#00\n"
        "(10.3) can0 120#0000\n"
        "broken\n"
    )
    out = tmp_path / "odd.parquet"
    assert main(["--dbc", str(DBC), "--log", str(log), "--out", str(out)]) == 0
    table = pl.read_parquet(out)
    outside = table.filter(~pl.col("in_range"))
    assert outside["signal"].to_list() == ["InnerBoomPosition"]
    assert math.isclose(outside["value"][0], -(2**23) * 4.794e-5)
    report = capsys.readouterr().out
    assert "4 frames read over 0.300 s: 1 decoded, 1 of 1 unknown ids, 2 not decodable" in report
    assert "not decodable: 1 frames of EncoderBase (120): 2 bytes, the DBC says 8" in report
    assert "1 damaged lines, skipped" in report


def test_gaps_are_reported_with_their_place(
    tmp_path: Path, crane: Layout, capsys: pytest.CaptureFixture[str]
) -> None:
    times = [0.005 * n for n in range(100) if not 40 <= n < 52]
    (frame,) = DriverCodec(crane).neutral_frames()
    log = tmp_path / "gap.log"
    log.write_text("\n".join(line(frame, time) for time in times))
    out = tmp_path / "gap.csv"
    assert main(["--dbc", str(DBC), "--log", str(log), "--out", str(out)]) == 0
    (row,) = [row for row in capsys.readouterr().out.splitlines() if row.startswith("ValveCommand")]
    assert " ".join(row.split()) == "ValveCommand 110 88 5.00 5 1 65.0 ms at 0.195 s"
