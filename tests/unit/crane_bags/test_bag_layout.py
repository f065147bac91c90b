import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from crane_bags import Topic, typestore
from crane_bags.types import (
    CYLINDER_PRESSURES,
    JOINT_REFERENCE,
    JOINT_STATES,
    VALVE_COMMAND,
    double_fields,
)
from crane_bags.writer import ArrayMessage

DOUBLES = st.floats(allow_nan=True, allow_infinity=True)
NAMES = st.lists(
    st.text(st.characters(exclude_characters="\0", exclude_categories=["Cs"])), min_size=1
)


@pytest.mark.parametrize(
    "topic",
    [JOINT_STATES, CYLINDER_PRESSURES, VALVE_COMMAND, JOINT_REFERENCE],
    ids=lambda topic: topic.name,
)
@settings(deadline=None)  # a busy machine is no failure
@given(names=NAMES, stamp=st.integers(0, 2**31 * 10**9 - 1), data=st.data())
def test_bytes_are_those_of_rosbags(
    topic: Topic, names: list[str], stamp: int, data: st.DataObject
) -> None:
    store = typestore()
    values = {
        field: np.array(data.draw(st.lists(DOUBLES, min_size=len(names), max_size=len(names))))
        if is_array
        else data.draw(DOUBLES)
        for field, is_array in double_fields(store, topic.msgtype).items()
    }
    types = store.types
    time = types["builtin_interfaces/msg/Time"](sec=stamp // 10**9, nanosec=stamp % 10**9)
    header = types["std_msgs/msg/Header"](stamp=time, frame_id="")
    message = types[topic.msgtype](header=header, name=names, **values)
    expected = store.serialize_cdr(message, topic.msgtype, little_endian=True)

    serialized = ArrayMessage(store, topic.msgtype, names).serialize(stamp, *values.values())
    assert bytes(serialized) == bytes(expected)


def test_values_of_the_wrong_length_are_refused() -> None:
    message = ArrayMessage(typestore(), VALVE_COMMAND.msgtype, ("slew", "inner_boom"))
    with pytest.raises(ValueError, match="broadcast"):
        message.serialize(0, [0.1, 0.2, 0.3])
    with pytest.raises(ValueError, match="argument"):
        message.serialize(0, [0.1, 0.2], [0.1, 0.2])


def test_type_with_other_fields_is_refused() -> None:
    with pytest.raises(ValueError, match="unit"):
        ArrayMessage(typestore(), "crane_interfaces/msg/ParameterEstimate", ("mass",))


def test_without_names_there_is_nothing_to_write() -> None:
    with pytest.raises(ValueError, match="at least one name"):
        ArrayMessage(typestore(), VALVE_COMMAND.msgtype, ())


@pytest.mark.parametrize(
    "topic",
    [JOINT_STATES, CYLINDER_PRESSURES, VALVE_COMMAND, JOINT_REFERENCE],
    ids=lambda topic: topic.name,
)
def test_many_at_once_are_the_same_bytes(topic: Topic) -> None:
    names, random = ["slew", "inner_boom", "telescope"], np.random.default_rng(3)
    message = ArrayMessage(typestore(), topic.msgtype, names)
    stamps = np.array([0, 999_999_999, 10**9, 1735689600_000000001, (2**31 - 1) * 10**9])
    values = [
        random.normal(size=(len(stamps), len(names)) if is_array else len(stamps))
        for is_array in message.fields.values()
    ]
    values[0][1] = np.nan
    rows = message.serialize_rows(stamps, *values)
    for k, stamp in enumerate(stamps.tolist()):
        assert rows[k].tobytes() == bytes(message.serialize(stamp, *(one[k] for one in values)))
