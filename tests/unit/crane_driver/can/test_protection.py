"""Counters and checksums against published check values."""

import crccheck
import pytest
from hypothesis import given
from hypothesis import strategies as st

from crane_driver.can.codec import frame_crc, lost_frames, sae_j1850


@pytest.mark.parametrize(  # AUTOSAR, Specification of CRC Routines, table of 8-bit SAE J1850
    ("data", "crc"),
    [
        ("00000000", 0x59),
        ("F20183", 0x37),
        ("0FAA0055", 0x79),
        ("00FF5511", 0xB8),
        ("332255AABBCCDDEEFF", 0xCB),
        ("926B55", 0x8C),
        ("FFFFFFFF", 0x74),
        (b"123456789".hex(), 0x4B),  # the check value of the catalogues of CRCs
    ],
)
def test_sae_j1850_of_published_test_data(data: str, crc: int) -> None:
    assert sae_j1850(bytes.fromhex(data)) == crc


@given(st.binary(max_size=64))
def test_sae_j1850_agrees_with_crccheck(data: bytes) -> None:
    assert sae_j1850(data) == crccheck.crc.Crc8SaeJ1850.calc(data)


@pytest.mark.parametrize(
    ("frame", "position", "data_id"),
    [
        # AUTOSAR, E2E Protocol Specification: profile 1, both bytes of the data id
        ("CC00000000000000", 0, 0x123),
        ("9101000000000000", 0, 0x123),
        # as the package autosar-e2e 0.6.1 protects them
        ("EA125634FFEE0901", 0, 0xBEEF),
        ("E8035A00E800", 4, 0x1244),
        ("E8035A00BB07", 4, 0x1244),
        ("E8035A004E0E", 4, 0x1244),
        ("861278", 0, 0x140),
    ],
)
def test_e2e_profile_1_of_published_frames(frame: str, position: int, data_id: int) -> None:
    data = bytes.fromhex(frame)
    assert frame_crc(data, position, data_id) == data[position]


@given(st.binary(min_size=2, max_size=8), st.integers(0, 0xFFFF), st.data())
def test_every_single_bit_error_is_found(data: bytes, data_id: int, draw: st.DataObject) -> None:
    bit = draw.draw(st.integers(8, 8 * len(data) - 1))  # byte 0 holds the CRC
    damaged = bytearray(data)
    damaged[bit // 8] ^= 1 << bit % 8
    assert frame_crc(bytes(damaged), 0, data_id) != frame_crc(data, 0, data_id)


def test_another_data_id_gives_another_crc() -> None:
    crcs = {frame_crc(bytes(8), 0, data_id) for data_id in range(0x100, 0x200)}
    assert len(crcs) == 256


@given(st.integers(0, 14), st.integers(0, 13))
def test_lost_frames_are_counted_across_the_wrap(counter: int, lost: int) -> None:
    assert lost_frames(counter, (counter + lost + 1) % 15, 15) == lost


def test_a_repeated_counter_is_told_from_a_loss() -> None:
    assert lost_frames(14, 14, 15) == -1
    assert lost_frames(14, 0, 15) == 0
