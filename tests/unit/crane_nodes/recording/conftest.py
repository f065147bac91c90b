"""Bags as the recorder writes them."""

from collections.abc import Callable
from pathlib import Path

import pytest

from crane_bags.types import JOINT_STATES
from crane_bags.writer import offered_qos
from crane_nodes.recording.bag import RecordedBag, RecordedTopic, Split, installed_definition

STEP = 5_000_000  # ns


@pytest.fixture(scope="session")
def topic() -> RecordedTopic:
    definition = installed_definition(JOINT_STATES.msgtype)
    return RecordedTopic(
        JOINT_STATES.name, JOINT_STATES.msgtype, definition, (offered_qos(JOINT_STATES),)
    )


@pytest.fixture
def record(
    tmp_path: Path, topic: RecordedTopic, joint_state: Callable[..., bytes]
) -> Callable[..., Path]:
    """Record `count` joint states at 200 Hz, flushed every `flush` messages, closed or not."""

    def write(
        count: int,
        name: str = "bag",
        close: bool = True,
        flush: int = 20,
        split: Split | None = None,
    ) -> Path:
        bag = RecordedBag(tmp_path / name, split)
        number = bag.add(topic)
        for k in range(count):
            data = joint_state(k * STEP, ["slew"], [float(k)])
            bag.write(number, k * STEP, data, sequence=k + 1)
            if (k + 1) % flush == 0:
                bag.flush()
        if close:
            bag.close()
        return bag.path

    return write
