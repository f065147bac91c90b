"""Counters and checksums of frames, as pure functions.

CRC-8 SAE J1850: AUTOSAR, Specification of CRC Routines. End-to-end profile 1 with both bytes of the
data id: AUTOSAR, E2E Protocol Specification; it starts the same polynomial at 0, without inversion.
"""

POLYNOMIAL = 0x1D  # x^8 + x^4 + x^3 + x^2 + 1


def _remainder(byte: int) -> int:
    for _ in range(8):
        byte = (byte << 1) ^ (POLYNOMIAL if byte & 0x80 else 0)
    return byte & 0xFF


TABLE = bytes(_remainder(byte) for byte in range(256))


def crc8(data: bytes, start: int = 0) -> int:
    """Remainder of `data` by the polynomial of SAE J1850, from `start`, neither inverted."""
    table, crc = TABLE, start
    for byte in data:
        crc = table[crc ^ byte]
    return crc


def sae_j1850(data: bytes) -> int:
    """CRC-8 SAE J1850: from 0xFF, inverted."""
    return crc8(data, 0xFF) ^ 0xFF


def autosar_e2e_1(data: bytes, data_id: int) -> int:
    """CRC of E2E profile 1 over the data id (16 bit, low byte first) and `data`."""
    return crc8(data, TABLE[TABLE[data_id & 0xFF] ^ (data_id >> 8)])


def frame_crc(data: bytes, position: int, data_id: int | None) -> int:
    """CRC of a frame over all its bytes but the one at `position`, which holds the CRC.

    By E2E profile 1 where there is a data id, else by SAE J1850 alone.
    """
    covered = data[:position] + data[position + 1 :]
    return sae_j1850(covered) if data_id is None else autosar_e2e_1(covered, data_id)


def lost_frames(previous: int, current: int, count: int) -> int:
    """Frames lost between two counters that run from 0 to count - 1: 0 is right, -1 a repetition.

    A loss of `count` frames or more looks like a smaller one.
    """
    return (current - previous) % count - 1
