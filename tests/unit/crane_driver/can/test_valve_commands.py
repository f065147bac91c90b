"""Valve commands that are not one ratio: pairs, magnitudes with a direction, single messages."""

import math
from collections.abc import Callable
from copy import deepcopy
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from crane_bags import read_topics
from crane_bags.types import CYLINDER_PRESSURES, JOINT_STATES, VALVE_COMMAND
from crane_driver import DriverCodec, MachineCodec, load_layout, load_safety
from crane_driver.can.frame import Frame, show_id
from crane_driver.can.health import HeardCommands
from crane_driver.can.layout import Layout
from crane_driver.decode import main
from crane_driver.driver_loop import DriverLoop
from crane_driver.safety.commands import RefusedError
from crane_driver.safety.supervisor import SafetyState
from crane_model import ConfigurationError, load_machine
from crane_model.machine_files import machine_file

Write = Callable[..., Path]

PRESSURE_8_BIT = "8@1+ (0.2,-10) [-10|40]"  # MPa, as an excavator has them
MESSAGES = {
    "Joints": (
        0x200,
        8,
        20,
        [(name, f"{16 * i}|16@1- (0.0002,0) [0|0]", "rad") for i, name in enumerate("SBKT")],
    ),
    "Oil": (0x201, 8, 20, [(n, f"{8 * i}|{PRESSURE_8_BIT}", "MPa") for i, n in enumerate("PQ")]),
    # two one-sided pilot pressures, in one message
    "Pilot": (
        0x100,
        8,
        20,
        [(name, f"{8 * i}|8@1+ (0.02,0) [0|5]", "MPa") for i, name in enumerate(("Up", "Down"))],
    ),
    # two one-sided currents, each in a message of its own
    "Coil1": (0x101, 2, 20, [("Current", "0|16@1+ (0.5,0) [0|1500]", "mA")]),
    "Coil2": (0x102, 2, 20, [("Current", "0|16@1+ (0.5,0) [0|1500]", "mA")]),
    # a magnitude with a state
    "Aux": (
        0x103,
        8,
        20,
        [
            ("Flow", "0|8@1+ (0.4,0) [0|100]", "%"),
            ("State", "16|4@1+ (1,0) [0|15]", ""),
            ("On", "20|1@1+ (1,0) [0|1]", ""),
        ],
    ),
    # one signal with both signs, in mA
    "Swing": (
        0x104,
        2,
        20,
        [("Current", "0|15@1- (0.1,0) [-800|800]", "mA"), ("On", "15|1@1+ (1,0) [0|1]", "")],
    ),
}
STATES = 'VAL_ 259 State 0 "Block" 1 "Extend" 2 "Retract" 3 "Float" 15 "NotAvailable" ;'
MAPPING: dict[str, Any] = {
    "positions": {
        joint: {"signal": f"Joints.{name}", "unit": "rad"}
        for joint, name in zip(("swing", "boom", "stick", "bucket"), "SBKT", strict=True)
    },
    "pressures": {
        f"boom.{side}": {"signal": f"Oil.{name}", "unit": "MPa"}
        for side, name in zip("ab", "PQ", strict=True)
    },
    "commands": {
        "boom": {"positive": "Pilot.Up", "negative": "Pilot.Down", "unit": "MPa", "full": 4.0},
        "stick": {
            "positive": "Coil1.Current",
            "negative": "Coil2.Current",
            "unit": "mA",
            "full": 600,
            "sign": -1,
        },
        "bucket": {
            "signal": "Aux.Flow",
            "unit": "%",
            "direction": {
                "signal": "Aux.State",
                "positive": "Retract",
                "negative": "Extend",
                "neutral": "Block",
            },
        },
        "swing": {"signal": "Swing.Current", "unit": "mA", "full": 600},
    },
    "enable": ["Aux.On", "Swing.On"],
    "timing": {"late": 10, "missing": 20, "lost": 2},
}
MACHINE = load_machine("excavator")
STEP = {"boom": 0.02 / 4, "stick": 0.5 / 600, "bucket": 0.004, "swing": 0.1 / 600}
commands = st.floats(-1.0, 1.0)


def without_commands() -> dict[str, Any]:
    return {key: value for key, value in MAPPING.items() if key not in ("commands", "enable")}


@pytest.fixture
def layout(write_dbc: Write, write_mapping: Write) -> Layout:
    return load_layout(MACHINE, write_mapping(MAPPING), write_dbc(MESSAGES, STATES))


def raw(frames: list[Frame]) -> dict[int, bytes]:
    return {frame.id: frame.data for frame in frames}


@given(values=st.fixed_dictionaries(dict.fromkeys(STEP, commands)))
@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=50)
def test_what_is_encoded_is_decoded(layout: Layout, values: dict[str, float]) -> None:
    heard = HeardCommands(layout)
    for frame in DriverCodec(layout).command_frames(values, enabled=True):
        command, faults = heard.observe(frame._replace(stamp=1, steady=1.0))
        assert not faults
    assert command is not None
    for joint, step in STEP.items():
        assert command.commands[joint] == pytest.approx(values[joint], abs=0.501 * step)
    sent = raw(DriverCodec(layout).command_frames(values, enabled=True))
    assert 0 in sent[0x100][:2], "one side of a pair is always neutral"
    assert bytes(2) in (sent[0x101], sent[0x102])


def test_a_side_that_reads_below_zero_opens_nothing(write_dbc: Write, write_mapping: Write) -> None:
    """Two signed currents that mirror one another: each counts on its own side only."""
    messages = MESSAGES | {
        name: (MESSAGES[name][0], 2, 20, [("Current", "0|16@1- (0.5,0) [-1500|1500]", "mA")])
        for name in ("Coil1", "Coil2")
    }
    heard = HeardCommands(load_layout(MACHINE, write_mapping(MAPPING), write_dbc(messages, STATES)))
    for number, current in ((0x101, 300), (0x102, -300)):
        data = int(current / 0.5).to_bytes(2, "little", signed=True)
        command, _ = heard.observe(Frame(number, data, stamp=1, steady=1.0))
    assert command is not None
    assert command.commands["stick"] == pytest.approx(-0.5)


def test_neutral_is_neutral_on_every_signal(layout: Layout) -> None:
    codec = DriverCodec(layout)
    codec.command_frames(dict.fromkeys(STEP, 1.0), enabled=True)
    sent = raw(codec.neutral_frames())
    assert set(sent) == {0x100, 0x101, 0x102, 0x103, 0x104}
    assert all(not any(data) for data in sent.values()), sent
    smallest = raw(codec.command_frames({"bucket": 1e-4}, enabled=True))[0x103]
    assert smallest[2] & 0xF == 0, "a magnitude of nothing has no direction"


def test_full_commands_are_what_the_mapping_says(layout: Layout) -> None:
    codec = DriverCodec(layout)
    sent = raw(codec.command_frames(dict.fromkeys(STEP, 1.0), enabled=True))
    assert sent[0x100][:2] == bytes((200, 0))  # 4 MPa
    assert (sent[0x101], sent[0x102]) == (bytes(2), (1200).to_bytes(2, "little"))  # sign -1
    assert sent[0x103][:3] == bytes((250, 0, 2 | 1 << 4))  # 100 %, Retract, enabled
    assert sent[0x104] == (6000 | 1 << 15).to_bytes(2, "little")
    sent = raw(codec.command_frames(dict.fromkeys(STEP, -0.5), enabled=False))
    assert sent[0x100][:2] == bytes((0, 100))
    assert (sent[0x101], sent[0x102]) == ((600).to_bytes(2, "little"), bytes(2))
    assert sent[0x103][:3] == bytes((125, 0, 1))


@pytest.mark.parametrize(
    ("joint", "entry", "message"),
    [
        (
            "boom",
            {"signal": "Pilot.Up", "unit": "MPa", "full": 4},
            "one side of the valve only; give both sides as positive and negative, or direction",
        ),
        (
            "boom",
            {"positive": "Pilot.Up", "negative": "Pilot.Down", "unit": "MPa"},
            "key 'commands.boom.full': full is needed: the signal at full opening, in MPa",
        ),
        ("boom", {"positive": "Pilot.Up", "unit": "MPa", "full": 4}, "both positive and negative"),
        (
            "boom",
            {"positive": "Pilot.Up", "negative": "Pilot.Down", "unit": "MPa", "full": 6},
            "carries -0.001",
        ),
        (
            "bucket",
            {
                "signal": "Aux.Flow",
                "unit": "%",
                "direction": {"signal": "Aux.State", "positive": "Out", "negative": "Retract"},
            },
            "signal Aux.State has no value Out; it has Block, Extend, Retract, Float, NotAvailable",
        ),
        (
            "bucket",
            {
                "signal": "Aux.Flow",
                "unit": "%",
                "direction": {"signal": "Pilot.Up", "positive": 1, "negative": 2},
            },
            "Pilot.Up and Aux.Flow are not in one message",
        ),
    ],
)
def test_an_entry_that_does_not_fit_is_named(
    write_dbc: Write, write_mapping: Write, joint: str, entry: dict[str, Any], message: str
) -> None:
    content = deepcopy(MAPPING)
    content["commands"][joint] = entry
    with pytest.raises(ConfigurationError, match=".") as caught:
        load_layout(MACHINE, write_mapping(content), write_dbc(MESSAGES, STATES))
    assert message in str(caught.value)


def test_a_side_that_cannot_be_neutral_is_refused(write_dbc: Write, write_mapping: Write) -> None:
    off = MESSAGES | {
        "Pilot": (
            *MESSAGES["Pilot"][:3],
            [("Up", "0|8@1+ (0.02,0.01) [0|0]", "MPa"), MESSAGES["Pilot"][3][1]],
        )
    }
    dbc, mapping = write_dbc(off, STATES), write_mapping(MAPPING)
    with pytest.raises(ConfigurationError, match="Pilot.Up cannot carry 0, the nearest is"):
        load_layout(MACHINE, mapping, dbc)
    assert load_layout(MACHINE, mapping, dbc, listen_only=True).valves


def test_a_driver_that_sends_needs_commands(write_dbc: Write, write_mapping: Write) -> None:
    dbc, mapping = write_dbc(MESSAGES, STATES), write_mapping(without_commands())
    with pytest.raises(ConfigurationError, match=r"no valve is mapped; .*\(driver: listen_only\)"):
        load_layout(MACHINE, mapping, dbc)
    assert load_layout(MACHINE, mapping, dbc, listen_only=True).valves == ()


def test_a_state_that_is_no_direction_is_a_fault_and_no_command(layout: Layout) -> None:
    (aux,) = (
        frame
        for frame in DriverCodec(layout).command_frames({"bucket": 0.5}, enabled=True)
        if frame.id == 0x103
    )
    floating = aux._replace(data=bytes((aux.data[0], 0, 3 | 1 << 4, *aux.data[3:])))
    command, (fault,) = HeardCommands(layout).observe(floating)
    assert command is not None
    assert math.isnan(command.commands["bucket"])
    assert "State of bucket is 3, which is not a direction" in str(fault)


CYCLES, CYCLE = 60, 0.02  # s: 50 Hz


def traffic(layout: Layout) -> list[Frame]:
    """The boom's valve opens and closes in a sine; frames of a valve in each message."""
    machine, driver = MachineCodec(layout), DriverCodec(layout)
    frames = []
    for cycle in range(CYCLES):
        opened = math.sin(cycle / 8)
        sent = driver.command_frames({"boom": opened, "bucket": -opened}, enabled=True)
        positions = dict.fromkeys(layout.positions, 0.1) | {"boom": 0.2 + 0.001 * cycle}
        pressures = {"boom.a": 12e6, "boom.b": 3e6}
        sent += [machine.reading_frame(one, positions, pressures, {}) for one in machine.cycles]
        for number, frame in enumerate(sent):
            now = 10.0 + cycle * CYCLE + 2e-4 * number
            frames.append(frame._replace(stamp=round(now * 1e9), steady=now))
    return frames


def write_log(path: Path, frames: list[Frame]) -> Path:
    lines = [
        f"({one.stamp * 1e-9:.6f}) can0 {show_id(one.id, one.extended)}#{one.data.hex()}"
        for one in frames
    ]
    path.write_text("\n".join(lines))
    return path


def test_a_log_with_such_commands_becomes_a_bag(
    layout: Layout, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log, out = write_log(tmp_path / "a.log", traffic(layout)), tmp_path / "bag"
    files = ["--dbc", str(tmp_path / "machine.dbc"), "--mapping", str(tmp_path / "machine.yaml")]
    given = ["--log", str(log), *files, "--machine", "excavator", "--out", str(out)]
    assert main(given) == 0, capsys.readouterr()
    topics = read_topics(out, (JOINT_STATES, CYLINDER_PRESSURES, VALVE_COMMAND))
    command = topics[VALVE_COMMAND.name]
    assert len(topics[JOINT_STATES.name].stamp) == CYCLES
    boom, bucket = (
        command.fields["command"][:, command.names.index(one)] for one in ("boom", "bucket")
    )
    cycle = np.round((command.stamp * 1e-9 - 10.0) / CYCLE - 0.02).astype(int)
    assert boom == pytest.approx(np.sin(cycle / 8), abs=0.003)
    heard = np.isfinite(bucket)
    assert heard[5:].all(), "a valve keeps to its command while other messages come"
    assert np.nanmax(bucket) > 0.95
    assert np.nanmin(bucket) < -0.95


def test_a_log_without_commands_becomes_a_bag(
    layout: Layout, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log, out = write_log(tmp_path / "a.log", traffic(layout)), tmp_path / "bag"
    mapping = tmp_path / "listener.yaml"
    mapping.write_text(yaml.safe_dump(without_commands()))
    given = ["--log", str(log), "--dbc", str(tmp_path / "machine.dbc"), "--mapping", str(mapping)]
    assert main([*given, "--machine", "excavator", "--out", str(out)]) == 0, capsys.readouterr()
    topics = read_topics(out, (JOINT_STATES, CYLINDER_PRESSURES), (VALVE_COMMAND,))
    assert VALVE_COMMAND.name not in topics
    pressures = topics[CYLINDER_PRESSURES.name].fields["chamber_a"]
    assert pressures[:, 0] == pytest.approx(np.full(CYCLES, 12e6))


@pytest.mark.parametrize("mapped", [True, False], ids=["commands", "no commands"])
def test_a_driver_that_only_listens_sends_nothing_and_says_why(
    layout: Layout, tmp_path: Path, mapped: bool
) -> None:
    (tmp_path / "listener.yaml").write_text(
        yaml.safe_dump(MAPPING if mapped else without_commands())
    )
    heard = load_layout(
        MACHINE, tmp_path / "listener.yaml", tmp_path / "machine.dbc", listen_only=True
    )
    safety = load_safety(machine_file("safety.yaml", "excavator"), MACHINE)
    density = dict.fromkeys(MACHINE.joint_names, 0.01)
    loop = DriverLoop(heard, MACHINE, safety, density, 10.0, listen_only=True)
    joints, spools, sent = [], [], []
    for frame in traffic(layout):
        joints += loop.receive([frame], [], frame.steady)[0]
        loop.check(0, frame.steady, frame.steady)
        spools += loop.take_heard()
        sent += loop.valve_frames(frame.steady) + loop.valve_frames(frame.steady, commanded=True)
        sent += loop.device_frames(frame.steady)
        assert loop.supervisor.state is SafetyState.LISTENING
    assert not sent
    assert not loop.supervisor.faults, loop.supervisor.faults
    assert len(joints) >= CYCLES - 1
    assert joints[-1].position[1] == pytest.approx(0.2 + 0.001 * (CYCLES - 1), abs=2e-4)
    assert bool(spools) == mapped
    if mapped:
        assert max(one.commands["boom"] for one in spools) > 0.95
    supervisor = loop.supervisor
    for asked in (
        lambda: supervisor.enable(12.0),
        supervisor.disable,
        supervisor.emergency_stop,
        lambda: supervisor.substitute("boom"),
    ):
        with pytest.raises(RefusedError, match=r"only listens \(parameter listen_only\)"):
            asked()
    loop.check(0, 20.0, 20.0)  # silence
    assert "valves neutral" not in supervisor.log[0].text
    assert supervisor.state is SafetyState.LISTENING
