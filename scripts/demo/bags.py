"""What the demo tells of a bag: counts, gaps, tracking, and the last online estimate."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from processes import DemoError

from crane_bags.clocks import NANOSECONDS
from crane_bags.reader import read_topics
from crane_bags.storage import announced, blocks, open_bag
from crane_bags.types import (
    CYLINDER_PRESSURES,
    JOINT_REFERENCE,
    JOINT_STATES,
    VALVE_COMMAND,
    Topic,
    typestore,
)

ESTIMATE = "/parameter_estimate"
GAP = 1.5  # cycles between two stamps


def messages(bag: Path) -> dict[str, int]:
    """Number of messages of each topic."""
    with open_bag(bag) as reader:
        topics = sorted({connection.topic for connection in reader.connections})
        return {topic: announced(reader, topic)[0] for topic in topics}


def gaps(bag: Path) -> dict[str, int]:
    """How often a topic of the control loop was silent for longer than 1.5 cycles."""
    topics = read_topics(bag, (JOINT_STATES, CYLINDER_PRESSURES), (VALVE_COMMAND, JOINT_REFERENCE))
    intervals = {name: np.diff(data.stamp) for name, data in topics.items()}
    cycle = np.median(intervals[JOINT_STATES.name])
    return {name: int((steps > GAP * cycle).sum()) for name, steps in intervals.items()}


class Told(NamedTuple):
    """What the messages of a topic say: stamps (n,) [ns], values (n, k)."""

    stamp: np.ndarray
    values: np.ndarray


def told(bag: Path, topic: Topic, values: Callable[[Any], Sequence[float]]) -> Told:
    """`values` of each message of a topic, in their order. `DemoError` if there is none."""
    store = typestore()
    stamps, found = [], []
    with open_bag(bag) as reader:
        for block in blocks(bag, reader, [topic.name]):
            for data in block.messages:
                message: Any = store.deserialize_cdr(data, topic.msgtype)
                stamp = message.header.stamp
                stamps.append(stamp.sec * NANOSECONDS + stamp.nanosec)
                found.append(values(message))
    if not found:
        raise DemoError(f"{bag}: nothing on {topic.name}")
    return Told(np.array(stamps, dtype=np.int64), np.array(found, dtype=float))


def online_estimate(bag: Path) -> dict[str, tuple[float, float]]:
    """Value and standard deviation of each parameter in the last estimate of the bag."""
    store = typestore()
    with open_bag(bag) as reader:
        (msgtype,) = {
            connection.msgtype for connection in reader.connections if connection.topic == ESTIMATE
        }
        last = [block.messages[-1] for block in blocks(bag, reader, [ESTIMATE])][-1]
    message: Any = store.deserialize_cdr(last, msgtype)
    values = zip(message.value.tolist(), message.std_dev.tolist(), strict=True)
    return dict(zip(message.name, values, strict=True))
