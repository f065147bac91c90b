"""DBC files of other people: loaded, or refused with a reason."""

from collections.abc import Callable
from pathlib import Path

import pytest

from crane_driver.can.codec import SignalBits
from crane_driver.can.dbc import by_group_alone, load_dbc
from crane_model import ConfigurationError

J1939 = """
BA_DEF_ BO_ "VFrameFormat" ENUM "StandardCAN","ExtendedCAN","reserved","J1939PG";
BA_DEF_DEF_ "VFrameFormat" "J1939PG";
"""


@pytest.mark.parametrize(
    ("name", "messages"),
    [("signed", 11), ("floating_point", 2), ("multiplex", 1), ("open_actuator", 5)],
)
def test_awkward_files_load(real_data: Path, name: str, messages: int) -> None:
    assert len(load_dbc(real_data / "dbc" / f"cantools_{name}.dbc").messages) == messages


def test_a_signal_beyond_its_message_is_refused(real_data: Path) -> None:
    path = real_data / "dbc" / "cantools_bad_message_length.dbc"
    with pytest.raises(ConfigurationError) as caught:
        load_dbc(path)
    assert str(caught.value) == (
        f"{path}: not a valid DBC file: The signal Signal1 does not fit in message Message1."
    )


def test_nothing_that_a_terminal_would_obey_is_printed_of_a_file(tmp_path: Path) -> None:
    path = tmp_path / "machine.dbc"
    path.write_bytes("\x1b[2J no DBC".encode("utf-16"))
    with pytest.raises(ConfigurationError, match="not a valid DBC file") as caught:
        load_dbc(path)
    assert str(caught.value).isprintable()


def test_flags_may_overlap_their_byte(write_dbc: Callable[..., Path]) -> None:
    signals = [
        ("Status", "0|8@1+ (1,0) [0|0]", ""),
        ("Alarm", "3|1@1+ (1,0) [0|0]", ""),
        ("Both", "7|16@0+ (1,0) [0|0]", ""),
        ("Angle", "16|16@1- (1,0) [0|0]", ""),
    ]
    (message,) = load_dbc(write_dbc({"Boom": (1, 4, 5, signals)})).messages.values()
    assert SignalBits(message).unpack(bytes.fromhex("0901FFFF")) == {
        "Status": 9,
        "Alarm": 1,
        "Both": 0x0901,
        "Angle": -1,
    }


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        (b"", "not a valid DBC file: Invalid syntax at line 1"),
        (b'VERSION ""\nBS_:\nBU_:\n', "no messages"),
        (b"positions: {slew: 1}\n", "not a valid DBC file: Invalid syntax at line 1"),
        (b"\x00\xff\x80" * 40, "not a valid DBC file"),
        (b"BU_: A\nBO_ 1 M: 8 A\n SG_ S : 0|8@1+ (1,0", r"of 1 signals \(SG_\) only 0 are whole"),
    ],
)
def test_what_is_no_dbc_file_is_refused(tmp_path: Path, content: bytes, reason: str) -> None:
    path = tmp_path / "machine.dbc"
    path.write_bytes(content)
    with pytest.raises(ConfigurationError, match=reason) as caught:
        load_dbc(path)
    assert str(caught.value).startswith(str(path))


@pytest.mark.parametrize(
    ("signals", "reason"),
    [
        ([("Angle", "0|16@1- (0,0) [0|0]", "")], "Angle of message Boom has the factor 0"),
        ([("Angle", f"{start}|8@1- (1,0) [0|0]", "") for start in (0, 8)], "two signals Angle"),
    ],
)
def test_signals_without_a_value_of_their_own_are_refused(
    signals: list[tuple[str, str, str]], reason: str, write_dbc: Callable[..., Path]
) -> None:
    path = write_dbc({"Boom": (0x98FF0121, 2, 5, signals)})
    with pytest.raises(ConfigurationError, match=reason):
        load_dbc(path)


def test_an_absent_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(ConfigurationError, match="absent.dbc: cannot be read: No such file"):
        load_dbc(tmp_path / "absent.dbc")


def test_two_messages_of_one_name_or_one_id_are_refused(write_dbc: Callable[..., Path]) -> None:
    path = write_dbc({"First": (0x100, 8, 0, []), "Second": (0x100, 8, 0, [])})
    with pytest.raises(ConfigurationError, match="First and Second have the same id 100"):
        load_dbc(path)
    path.write_text(path.read_text().replace("BO_ 256 Second", "BO_ 257 First"))
    with pytest.raises(ConfigurationError, match="two messages have the name First"):
        load_dbc(path)


@pytest.mark.parametrize(
    "encoding", ["utf-8", "cp1252", "utf-8-sig", "utf-16", "utf-16-be", "gb2312"]
)
def test_units_are_read_in_every_encoding(write_dbc: Callable[..., Path], encoding: str) -> None:
    path = write_dbc({"Boom": (1, 8, 5, [("Angle", "0|16@1- (1,0) [0|0]", "°")])})
    mark = "\ufeff" if encoding == "utf-16" else ""  # left over by a conversion
    path.write_bytes((mark + path.read_text()).encode(encoding))
    (signal,) = load_dbc(path).messages["Boom"].signals
    assert signal.unit == "°"


def extended(identifier: int) -> int:
    return identifier | 0x80000000


def test_j1939_messages_are_found_by_their_group(write_dbc: Callable[..., Path]) -> None:
    dbc = load_dbc(
        write_dbc(
            {
                "Broadcast": (extended(0x0CF004FE), 8, 0, []),
                "Addressed": (extended(0x18EFFFFE), 8, 0, []),
                "Standard": (0x100, 8, 0, []),
            },
            J1939,
        )
    )
    broadcast = dbc.messages["Broadcast"]
    assert dbc.find(0x0CF00400, True) is broadcast  # another source address
    assert dbc.find(0x18F00421, True) is broadcast  # another priority, too
    assert dbc.find(0x0CF00500, True) is None  # another group
    assert dbc.find(0x18EF2700, True) is dbc.messages["Addressed"]  # to any destination
    assert dbc.find(0x100, False) is dbc.messages["Standard"]
    assert dbc.find(0x100, True) is None


def test_an_exact_identifier_comes_before_the_group(write_dbc: Callable[..., Path]) -> None:
    dbc = load_dbc(
        write_dbc(
            {
                "First": (extended(0x0CF00400), 8, 0, []),
                "Second": (extended(0x0CF00421), 8, 0, []),
            },
            J1939,
        )
    )
    assert dbc.find(0x0CF00421, True) is dbc.messages["Second"]
    assert dbc.find(0x0CF00433, True) is None, "either could be meant"


def test_what_the_dbc_says_to_be_another_format_matches_exactly(
    write_dbc: Callable[..., Path],
) -> None:
    own = extended(0x0CF00400)
    stated = J1939.replace('"J1939PG"', '"ExtendedCAN"', 1) + f'\nBA_ "VFrameFormat" BO_ {own} 1;'
    dbc = load_dbc(write_dbc({"Own": (own, 8, 0, [])}, stated))
    assert dbc.find(0x0CF00400, True) is not None
    assert dbc.find(0x0CF00421, True) is None


def test_a_dbc_that_says_nothing_may_be_of_j1939(write_dbc: Callable[..., Path]) -> None:
    dbc = load_dbc(write_dbc({"Own": (extended(0x0CF004FE), 8, 0, [])}))
    message = dbc.find(0x0CF00421, True)
    assert message is dbc.messages["Own"]
    assert by_group_alone(message, "0CF00421")
    assert not by_group_alone(message, "0CF004FE")


def test_a_message_to_one_address_is_not_that_to_another(write_dbc: Callable[..., Path]) -> None:
    dbc = load_dbc(write_dbc({"Addressed": (extended(0x18EF21FE), 8, 0, [])}, J1939))
    assert dbc.find(0x18EF2105, True) is dbc.messages["Addressed"]
    assert dbc.find(0x18EF2205, True) is None
