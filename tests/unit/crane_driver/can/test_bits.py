"""Bytes to raw values and back, as cantools itself does it."""

import cantools
import pytest
from cantools.database.can import Message
from hypothesis import given
from hypothesis import strategies as st

from crane_driver.can.codec import SignalBits
from crane_driver.can.dbc import load_dbc
from crane_model.machine_files import machine_file

MIXED = """VERSION ""
BS_:
BU_: Unit
BO_ 1 Mixed: 8 Unit
 SG_ Little : 0|5@1+ (1,0) [0|0] "" Unit
 SG_ Signed : 5|11@1- (0.5,3) [0|0] "" Unit
 SG_ Big : 23|10@0+ (1,0) [0|0] "" Unit
 SG_ BigSigned : 29|6@0- (1,0) [0|0] "" Unit
 SG_ Real : 32|32@1- (1,0) [0|0] "" Unit
BO_ 2 Multiplexed: 3 Unit
 SG_ Which M : 0|8@1+ (1,0) [0|0] "" Unit
 SG_ First m0 : 8|8@1+ (1,0) [0|0] "" Unit
 SG_ Second m1 : 8|12@1- (1,0) [0|0] "" Unit
SIG_VALTYPE_ 1 Real : 1;
"""
MESSAGES = {
    **{one.name: one for one in cantools.database.load_string(MIXED, "dbc").messages},
    **load_dbc(machine_file("can.dbc")).messages,
}
REAL = slice(4, 8)  # bytes of Mixed.Real


def raw(message: Message, data: bytes) -> dict[str, float]:
    return dict(message.decode_simple(data, False, False))  # type: ignore[arg-type]


@pytest.mark.parametrize("name", MESSAGES)
@given(content=st.binary(min_size=8, max_size=8))
def test_every_content_is_read_and_written_as_by_cantools(name: str, content: bytes) -> None:
    message = MESSAGES[name]
    data = content[: message.length]
    if name == "Multiplexed":
        data = bytes((data[0] % 2,)) + data[1:]
    if name == "Mixed":  # what is not a number does not equal itself
        data = data[: REAL.start] + b"\0\0" + data[REAL.start + 2 :][:1] + b"\x40"
    bits, expected = SignalBits(message), raw(message, data)
    assert bits.unpack(data) == expected
    assert bits.pack(expected) == message.encode(expected, False, False, False)


def test_a_multiplexer_value_that_the_dbc_does_not_have_is_an_error() -> None:
    with pytest.raises(cantools.database.DecodeError):
        SignalBits(MESSAGES["Multiplexed"]).unpack(b"\x07\0\0")
