"""A mapping against a DBC: what fits, and every contradiction named."""

from collections.abc import Callable
from copy import deepcopy
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from crane_driver import DriverCodec, MachineCodec, load_layout
from crane_model import ConfigurationError, load_machine

WriteDbc = Callable[..., Path]
WriteMapping = Callable[[dict[str, Any]], Path]

MESSAGES = {
    "Sensors": (
        0x200,
        8,
        10,
        [
            ("Boom", "0|16@1- (0.01,0) [-180|180]", "deg"),
            ("BoomError", "16|1@1+ (1,0) [0|1]", ""),
            ("Piston", "24|8@1+ (0.5,-5) [0|0]", "bar"),
            ("Alive", "32|2@1+ (1,0) [0|0]", ""),
            ("Check", "40|8@1+ (1,0) [0|0]", ""),
            ("Mode", "48|3@1+ (1,0) [0|7]", ""),
        ],
    ),
    "Valve": (
        0x100,
        4,
        20,
        [
            ("Boom", "0|8@1- (1,0) [-100|100]", "%"),
            ("Key", "8|8@1+ (1,0) [0|0]", ""),
            ("On", "16|1@1+ (1,0) [0|1]", ""),
        ],
    ),
    "Long": (0x280, 39, 10, [("Byte", "304|8@1+ (1,0) [0|0]", "")]),
    "Unused": (0x300, 8, 0, [("Word", "0|16@1+ (1,0) [0|0]", "")]),
}
MODES = 'VAL_ 512 Mode 0 "Off" 1 "Run" ;'
MAPPING: dict[str, Any] = {
    "positions": {
        "inner_boom": {
            "signal": "Sensors.Boom",
            "unit": "deg",
            "sign": -1,
            "zero": 0.25,
            "fault": "Sensors.BoomError",
        }
    },
    "pressures": {"inner_boom.a": {"signal": "Sensors.Piston", "unit": "bar", "zero": 1e5}},
    "commands": {"inner_boom": {"signal": "Valve.Boom", "unit": "%", "sign": -1}},
    "enable": "Valve.On",
    "constants": {"Valve.Key": 90},
    "states": {"sensors": {"signal": "Sensors.Mode", "healthy": ["Run", 5]}},
    "protection": {
        "Sensors": {"counter": "Alive", "crc": "Check", "profile": "sae_j1850"},
    },
    "timing": {"late": 3, "missing": 10, "lost": 0},
}


def changed(**changes: Any) -> dict[str, Any]:
    """The mapping with entries replaced; names of keys are joined by double underscores."""
    content = deepcopy(MAPPING)
    for path, value in changes.items():
        *parents, last = path.split("__")
        target = content
        for parent in parents:
            target = target[parent]
        target[last] = value
    return content


def test_another_machine_s_units_signs_zeros_and_checksums(
    write_dbc: WriteDbc, write_mapping: WriteMapping
) -> None:
    layout = load_layout(load_machine(), write_mapping(MAPPING), write_dbc(MESSAGES, MODES))
    machine, driver = MachineCodec(layout), DriverCodec(layout)
    frame = machine.reading_frame(
        "Sensors", {"inner_boom": 0.1}, {"inner_boom.a": 30e5}, {"sensors": "Run"}
    )
    # reading = zero + sign * joint = 0.15 rad = 8.59 deg
    assert int.from_bytes(frame.data[:2], "little", signed=True) == 859
    assert frame.data[3] == (31 + 5) * 2  # 30 bar above a zero of 1 bar
    readings = driver.decode(frame)
    assert readings is not None
    assert not readings.faults
    assert readings.positions["inner_boom"] == pytest.approx(0.1, abs=0.01 * 3.1416 / 180)
    assert readings.pressures["inner_boom.a"] == pytest.approx(30e5, abs=1.0)
    assert readings.counter == 0

    (command,) = driver.command_frames({"inner_boom": 0.5}, enabled=True)
    assert command.data == bytes((256 - 50, 90, 1, 0))


def test_the_counter_takes_the_values_that_its_bits_hold(
    write_dbc: WriteDbc, write_mapping: WriteMapping
) -> None:
    layout = load_layout(load_machine(), write_mapping(MAPPING), write_dbc(MESSAGES, MODES))
    assert layout.readings[0].protection.counter_count == 4


@pytest.mark.parametrize(
    ("changes", "messages"),
    [
        (
            {"positions__inner_boom__signal": "Sensor.Boom"},
            ["key 'positions.inner_boom': no message Sensor in", "Sensors, Valve, Long, Unused"],
        ),
        (
            {"positions__inner_boom__signal": "Sensors.Bom"},
            ["message Sensors of", "has no signal Bom: Boom, BoomError"],
        ),
        (
            {"positions__inner_boom__unit": "rad"},
            ["key 'positions.inner_boom.unit': 'rad', but Sensors.Boom is in 'deg'"],
        ),
        (
            {"pressures__inner_boom.a__signal": "Sensors.Boom"},
            ["key 'pressures.inner_boom.a': signal Sensors.Boom is already mapped by 'positions"],
        ),
        (
            {"positions__inner_boom__fault": "Valve.On"},
            ["Valve.On and Sensors.Boom are not in the same message"],
        ),
        (
            {"positions__inner_boom__fault": "Sensors.Error"},
            ["key 'positions.inner_boom.fault': message Sensors", "has no signal Error"],
        ),
        ({"constants": {}}, ["what shall be sent as Valve.Key?"]),
        ({"constants__Valve.Key": 300}, ["300 is not a raw value of Valve.Key: 0 to 255"]),
        (
            {"states__sensors__healthy": ["Running"]},
            ["key 'states.sensors.healthy': signal Sensors.Mode has no value Running", "Off, Run"],
        ),
        (
            {"protection__Sensors__crc": "Boom"},
            ["key 'protection.Sensors.crc': signal Sensors.Boom is already mapped"],
        ),
        (
            {"protection__Sensors__crc": "Alive", "protection__Sensors__counter": "Check"},
            ["signal Sensors.Alive is not one whole byte"],
        ),
        ({"protection__Unused": {"counter": "Word"}}, ["nothing else is mapped from message Unus"]),
        ({"protection__Nobody": {"counter": "Word"}}, ["no message Nobody"]),
        (
            {"states__long": {"signal": "Long.Byte", "healthy": [0]}},
            ["message Long has 39 bytes, a frame holds 8"],
        ),
        (
            {"states__unused": {"signal": "Unused.Word", "healthy": [0]}},
            ["message Unused of", "has no cycle time: add GenMsgCycleTime"],
        ),
        (
            {"states__valve": {"signal": "Valve.Key", "healthy": [0]}, "constants": {}},
            ["message Valve cannot both be sent and hold what is received"],
        ),
        (
            {
                "constants": {},
                "states": {},
                "protection__Valve": {"counter": "Key", "accepted": "Sensors.Mode"},
            },
            ["protection.Valve.accepted': signal Sensors.Mode carries 0 to 7, the counter runs"],
        ),
        (
            {
                "states": {},
                "protection__Sensors": {"counter": "Alive", "accepted": "Sensors.Mode"},
            },
            ["protection.Sensors.accepted': Sensors accepts what is sent; Sensors is not"],
        ),
    ],
)
def test_a_contradiction_is_named(
    write_dbc: WriteDbc,
    write_mapping: WriteMapping,
    changes: dict[str, Any],
    messages: list[str],
) -> None:
    mapping = write_mapping(changed(**changes))
    dbc = write_dbc(MESSAGES, MODES)
    with pytest.raises(ConfigurationError) as caught:
        load_layout(load_machine(), mapping, dbc)
    assert all(line.startswith(str(mapping)) for line in str(caught.value).splitlines())
    for message in messages:
        assert message in str(caught.value)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"positions__gripper": MAPPING["positions"]["inner_boom"]}, "no joint gripper; labor"),
        ({"pressures__inner_boom": {"signal": "A.B", "unit": "bar"}}, "no pressure inner_boom;"),
        ({"positions__inner_boom__signal": "Boom"}, "key 'positions.inner_boom.signal'"),
        ({"positions__inner_boom__sign": 2}, "key 'positions.inner_boom.sign'"),
        ({"protection__Sensors__profile": None}, "crc and profile belong together"),
        ({"protection__Sensors__data_id": 1}, "data_id belongs to profile autosar_e2e_1"),
        ({"protection__Sensors": {}}, "name the signal of a counter or of a crc"),
        (
            {"protection__Sensors__accepted": "Unused.Word", "protection__Sensors__counter": None},
            "accepted gives back a counter",
        ),
        ({"timing__missing": 2}, "missing is 2.0, it must be more than late, 3.0"),
        ({"speed": 1}, "key 'speed'"),
    ],
)
def test_a_wrong_mapping_file_is_refused_by_key(
    write_dbc: WriteDbc, write_mapping: WriteMapping, changes: dict[str, Any], message: str
) -> None:
    with pytest.raises(ConfigurationError, match=message):
        load_layout(load_machine(), write_mapping(changed(**changes)), write_dbc(MESSAGES, MODES))


def test_a_signal_without_unit_takes_that_of_the_mapping(
    write_dbc: WriteDbc, write_mapping: WriteMapping
) -> None:
    mapping = changed(**{"pressures__inner_boom.a__signal": "Sensors.Mode", "states": {}})
    layout = load_layout(load_machine(), write_mapping(mapping), write_dbc(MESSAGES, MODES))
    assert layout.resolution("inner_boom.a") == 1e5


@pytest.mark.parametrize("spelled", ["°", "º", "Grad", "Degree", "[deg]", "\xa1\xe3", " DEG "])
def test_units_are_compared_by_what_they_mean(
    spelled: str, write_dbc: WriteDbc, write_mapping: WriteMapping
) -> None:
    messages = deepcopy(MESSAGES)
    name, how, _ = messages["Sensors"][3][0]
    messages["Sensors"][3][0] = (name, how, spelled)
    layout = load_layout(load_machine(), write_mapping(MAPPING), write_dbc(messages, MODES))
    assert layout.resolution("inner_boom") == pytest.approx(0.01 * np.pi / 180)


@pytest.mark.parametrize(
    ("spelled", "shown"), [("klick", "'klick'"), ("\xa1\xe6", "'\xa1\xe6' or '℃'")]
)
def test_a_unit_that_is_not_known_is_answered_by_those_that_are(
    spelled: str, shown: str, write_dbc: WriteDbc, write_mapping: WriteMapping
) -> None:
    messages = deepcopy(MESSAGES)
    name, how, _ = messages["Sensors"][3][0]
    messages["Sensors"][3][0] = (name, how, spelled)
    with pytest.raises(
        ConfigurationError, match=f"in {shown}, which is none of rad, deg, °, .*grad"
    ):
        load_layout(load_machine(), write_mapping(MAPPING), write_dbc(messages, MODES))


def test_a_message_whose_signals_overlap_is_not_sent(
    write_dbc: WriteDbc, write_mapping: WriteMapping
) -> None:
    messages = deepcopy(MESSAGES)
    messages["Valve"][3].append(("Flag", "0|1@1+ (1,0) [0|0]", ""))
    mapping = changed(constants={"Valve.Key": 90, "Valve.Flag": 0})
    with pytest.raises(ConfigurationError, match="signals of message Valve overlap"):
        load_layout(load_machine(), write_mapping(mapping), write_dbc(messages, MODES))


def test_all_contradictions_are_listed_at_once(
    write_dbc: WriteDbc, write_mapping: WriteMapping
) -> None:
    mapping = changed(
        positions__inner_boom__unit="rad", states__sensors__signal="Sensors.State", constants={}
    )
    with pytest.raises(ConfigurationError) as caught:
        load_layout(load_machine(), write_mapping(mapping), write_dbc(MESSAGES, MODES))
    assert len(str(caught.value).splitlines()) == 3


def test_a_valve_signal_must_carry_the_whole_command(
    write_dbc: WriteDbc, write_mapping: WriteMapping
) -> None:
    messages = deepcopy(MESSAGES)
    messages["Valve"][3][0] = ("Boom", "0|8@1- (1,0) [-50|100]", "%")
    with pytest.raises(ConfigurationError, match=r"Valve.Boom carries -1.0\d* to 0.5"):
        load_layout(load_machine(), write_mapping(MAPPING), write_dbc(messages, MODES))


@settings(
    max_examples=40, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(
    length=st.integers(4, 32),
    signed=st.booleans(),
    big_endian=st.booleans(),
    scale=st.sampled_from([1.0, 0.1, 0.005, 0.0625, 2.5]),
    dbc_offset=st.sampled_from([0.0, -125.0, 12.25]),
    sign=st.sampled_from([-1, 1]),
    zero=st.floats(-3, 3),
    share=st.floats(0, 1),
)
def test_any_signal_comes_back_within_half_a_step(
    write_dbc: WriteDbc,
    write_mapping: WriteMapping,
    length: int,
    signed: bool,
    big_endian: bool,
    scale: float,
    dbc_offset: float,
    sign: int,
    zero: float,
    share: float,
) -> None:
    order = f"{7 if big_endian else 0}|{length}@{0 if big_endian else 1}{'-' if signed else '+'}"
    messages = deepcopy(MESSAGES)
    messages["Angle"] = (0x210, 8, 10, [("Boom", f"{order} ({scale},{dbc_offset}) [0|0]", "rad")])
    mapping = changed(
        positions={
            "outer_boom": {"signal": "Angle.Boom", "unit": "rad", "sign": sign, "zero": zero}
        }
    )
    layout = load_layout(load_machine(), write_mapping(mapping), write_dbc(messages, MODES))
    (channel,) = next(one for one in layout.readings if one.name == "Angle").positions
    value = min(channel.low + share * (channel.high - channel.low), channel.high)
    frame = MachineCodec(layout).reading_frame("Angle", {"outer_boom": value}, {}, {})
    readings = DriverCodec(layout).decode(frame)
    assert readings is not None
    assert not readings.faults
    assert readings.positions["outer_boom"] == pytest.approx(value, abs=scale / 2 * (1 + 1e-9))
