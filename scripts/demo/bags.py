"""What the demo tells of a bag: counts, gaps, tracking, and the last online estimate."""

from pathlib import Path
from typing import Any

import numpy as np

from crane_bags import read_topics, typestore
from crane_bags.storage import announced, blocks, open_bag
from crane_bags.types import CYLINDER_PRESSURES, JOINT_REFERENCE, JOINT_STATES, VALVE_COMMAND

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
