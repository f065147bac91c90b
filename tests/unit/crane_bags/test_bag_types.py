import json
from pathlib import Path

import pytest
from ament_index_python.packages import get_package_share_path

from crane_bags import Topic, types, typestore
from crane_bags.types import (
    CYLINDER_PRESSURES,
    DRIVER_STATE,
    JOINT_REFERENCE,
    JOINT_STATES,
    ROBOT_DESCRIPTION,
    VALVE_COMMAND,
    double_fields,
)
from crane_model import CraneError

TOPICS = [
    *(JOINT_STATES, CYLINDER_PRESSURES, VALVE_COMMAND, JOINT_REFERENCE),
    *(ROBOT_DESCRIPTION, DRIVER_STATE),
]


@pytest.mark.parametrize("topic", TOPICS, ids=lambda topic: topic.name)
def test_type_hash_is_the_one_that_rosidl_generated(topic: Topic) -> None:
    package, _, name = topic.msgtype.split("/")
    description = json.loads((get_package_share_path(package) / "msg" / f"{name}.json").read_text())
    hashes = {one["type_name"]: one["hash_string"] for one in description["type_hashes"]}
    assert typestore().hash_rihs01(topic.msgtype) == hashes[topic.msgtype]


def test_double_fields_in_their_order() -> None:
    fields = double_fields(typestore(), CYLINDER_PRESSURES.msgtype)
    assert list(fields.items()) == [
        ("chamber_a", True),
        ("chamber_b", True),
        ("supply", False),
        ("tank", False),
    ]


def test_definitions_that_did_not_come_along(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(types, "DEFINITIONS", tmp_path / "msg")
    with pytest.raises(CraneError, match="no .msg files; this is a link to crane_interfaces/msg"):
        typestore.__wrapped__()
