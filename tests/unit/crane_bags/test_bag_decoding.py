"""Decoding in bulk gives what rosbags gives message by message, whatever the bytes."""

from collections.abc import Callable, Sequence

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rosbags.serde import SerdeError

from crane_bags import decoding, typestore
from crane_bags.decoding import (
    Table,
    UnusualError,
    blocks,
    decode,
    decode_by_rosbags,
    find_layout,
    same,
)
from crane_bags.types import CYLINDER_PRESSURES, JOINT_STATES

Serializer = Callable[..., bytes]
NAMES = st.lists(
    st.text(st.characters(exclude_characters="\0", exclude_categories=["Cs"]), max_size=9),
    max_size=4,
)
DOUBLES = st.floats(allow_nan=True, allow_infinity=True)


@st.composite
def joint_state_bytes(draw: st.DrawFn) -> bytes:
    """CDR of a JointState of any names, with any of its arrays empty, in either byte order."""
    types = typestore().types
    names = draw(st.sampled_from([["slew", "boom"], ["boom"], ["b", "b"], []]) | NAMES)
    arrays = {
        field: np.array(draw(st.lists(DOUBLES, min_size=len(names), max_size=len(names))))
        if draw(st.booleans())
        else np.empty(0)
        for field in ("position", "velocity", "effort")
    }
    stamp = types["builtin_interfaces/msg/Time"](
        sec=draw(st.integers(-(2**31), 2**31 - 1)), nanosec=draw(st.integers(0, 2**32 - 1))
    )
    header = types["std_msgs/msg/Header"](stamp=stamp, frame_id=draw(st.sampled_from(["", "base"])))
    message = types[JOINT_STATES.msgtype](header=header, name=names, **arrays)
    little = draw(st.integers(0, 9)) > 0
    return bytes(typestore().serialize_cdr(message, JOINT_STATES.msgtype, little_endian=little))


def outcome(
    decoder: Callable[..., Table], messages: Sequence[bytes], msgtype: str
) -> Table | type[Exception]:
    try:
        return decoder(messages, msgtype, typestore())
    except (SerdeError, ValueError) as error:
        return type(error)


def check_like_rosbags(messages: Sequence[bytes], msgtype: str = JOINT_STATES.msgtype) -> None:
    bulk = outcome(decode, messages, msgtype)
    expected = outcome(decode_by_rosbags, messages, msgtype)
    if isinstance(expected, Table):
        assert isinstance(bulk, Table)
        order = [bulk.names.index(name) for name in expected.names]
        assert same(
            Table(
                tuple(bulk.names[i] for i in order),
                bulk.stamp,
                bulk.present[:, order],
                {
                    key: value[:, order] if value.ndim == 2 else value
                    for key, value in bulk.fields.items()
                },
            ),
            expected,
        )
    else:
        assert not isinstance(bulk, Table)


@given(st.lists(joint_state_bytes(), min_size=1, max_size=12))
def test_any_messages(messages: list[bytes]) -> None:
    check_like_rosbags(messages)


@given(
    st.lists(joint_state_bytes(), min_size=1, max_size=3),
    st.integers(0, 400),
    st.integers(0, 255),
    st.booleans(),
)
def test_any_damage(messages: list[bytes], place: int, value: int, cut: bool) -> None:
    """A wrong byte, or an end that is missing, in the last of some equal messages."""
    damaged = bytearray(messages[0])
    damaged[place % len(damaged)] = value
    check_like_rosbags([*messages, bytes(damaged[: place + 1] if cut else damaged)])


def test_padding_may_hold_anything(joint_state: Serializer) -> None:
    clean = joint_state(1, ["abc", "d"], [1.0, 2.0])
    layout = find_layout(clean, JOINT_STATES.msgtype, typestore())
    used = set(layout.fixed.tolist()) | set(range(2, 12))
    used |= {at + i for at, count in layout.doubles.values() for i in range(8 * count)}
    padding = sorted(set(range(len(clean))) - used)
    assert padding
    scribbled = bytearray(clean)
    for place in padding:
        scribbled[place] = 0xAA
    found = list(blocks([clean, bytes(scribbled)], JOINT_STATES.msgtype, typestore()))
    assert [rows.tolist() for rows, _, _ in found] == [[0, 1]]
    check_like_rosbags([clean, bytes(scribbled)])


def test_usual_messages_are_decoded_in_bulk(
    joint_state: Serializer, monkeypatch: pytest.MonkeyPatch
) -> None:
    """rosbags sees one message of each layout, which is what makes it fast."""
    seen: list[int] = []

    def counting(messages: Sequence[bytes], *arguments: object) -> Table:
        seen.append(len(messages))
        return decode_by_rosbags(messages, *arguments)  # type: ignore[arg-type]

    monkeypatch.setattr(decoding, "decode_by_rosbags", counting)
    messages = [joint_state(k, ["a", "b"], [k, -k]) for k in range(50)]
    messages += [joint_state(k, ["b"], [k], [2.0 * k]) for k in range(50, 60)]
    table = decode(messages, JOINT_STATES.msgtype, typestore())
    assert seen == [1, 1]
    assert table.stamp.tolist() == list(range(60))
    assert table.fields["position"][:, table.names.index("b")].tolist() == [
        *range(0, -50, -1),
        *range(50, 60),
    ]
    assert np.isnan(table.fields["position"][50:, table.names.index("a")]).all()


def test_another_type_is_not_for_bulk() -> None:
    types = typestore().types
    text = types["std_msgs/msg/String"](data="hello")
    data = bytes(typestore().serialize_cdr(text, "std_msgs/msg/String"))
    with pytest.raises(UnusualError, match="another type"):
        find_layout(data, "std_msgs/msg/String", typestore())


def test_scalars_beside_arrays() -> None:
    types = typestore().types
    header = types["std_msgs/msg/Header"](
        stamp=types["builtin_interfaces/msg/Time"](sec=1, nanosec=2), frame_id=""
    )
    messages = [
        bytes(
            typestore().serialize_cdr(
                types[CYLINDER_PRESSURES.msgtype](
                    header=header,
                    name=["boom"],
                    chamber_a=np.array([1.0 + k]),
                    chamber_b=np.array([2.0]),
                    supply=3.0 + k,
                    tank=np.nan,
                ),
                CYLINDER_PRESSURES.msgtype,
            )
        )
        for k in range(3)
    ]
    check_like_rosbags(messages, CYLINDER_PRESSURES.msgtype)
    table = decode(messages, CYLINDER_PRESSURES.msgtype, typestore())
    assert table.fields["supply"].tolist() == [3.0, 4.0, 5.0]
