"""From messages of topics of any name and type, by their column map, to the estimator."""

from collections.abc import Callable
from typing import Any

import numpy as np

from crane_bags.clocks import NANOSECONDS
from crane_identification.data.column_map import ColumnMap
from crane_identification.online.estimator import Forces, OnlineEstimator
from crane_identification.online.gathering import Gathering
from crane_identification.online.recent import Watched
from crane_identification.online.topics import Listener
from crane_model.errors import ConfigurationError, DataError
from crane_nodes.recording.definitions import message_class
from crane_nodes.stamps import nanoseconds

Feed = tuple[Gathering, Callable[[int, np.ndarray], list[Forces]]]


def mapped_listeners(
    estimator: OnlineEstimator | Watched, column_map: ColumnMap, file: str
) -> tuple[Listener, ...]:
    """Who passes positions and chamber pressures on, a listener of each topic of the map.

    `ConfigurationError` if the map, of `file`, lacks pressures, or the type of a topic.
    """
    joints = column_map.of(estimator.model.joints, file)
    if absent := [one for one in joints if one.pressure_a is None or one.pressure_b is None]:
        name = estimator.model.joints[joints.index(absent[0])]
        raise ConfigurationError(
            f"{file}: key 'joints.{name}': pressure_a and pressure_b are needed: the node computes "
            "forces from them"
        )
    chambers = [
        source
        for side in ("pressure_a", "pressure_b")
        for one in joints
        if (source := getattr(one, side))
    ]
    gap = round(estimator.options.largest_gap * NANOSECONDS)
    positions = Gathering([one.position for one in joints], gap)
    pressures = Gathering(chambers, gap)

    def add_pressure(stamp: int, values: np.ndarray) -> list[Forces]:
        return estimator.add_pressure(stamp, *np.split(values, 2))

    feeds: list[Feed] = [(positions, estimator.add_position), (pressures, add_pressure)]
    listeners = []
    for topic in dict.fromkeys((*positions.topics, *pressures.topics)):
        if topic not in column_map.types:
            raise ConfigurationError(
                f"{file}: topic {topic}: give its type, such as sensor_msgs/msg/JointState; the "
                "node listens before anyone has to publish"
            )
        mine = [(gathering, add) for gathering, add in feeds if topic in gathering.topics]
        take = _taker(topic, mine)
        listeners.append(Listener(topic, message_class(column_map.types[topic]), take))
    return tuple(listeners)


def _taker(topic: str, feeds: list[Feed]) -> Callable[[Any, int], list[Forces]]:
    def take(message: Any, sent: int) -> list[Forces]:
        stamp = nanoseconds(message.header.stamp) if hasattr(message, "header") else 0
        try:
            return [
                forces
                for gathering, add in feeds
                for complete in gathering.add(topic, stamp or sent, message)
                for forces in add(complete.stamp, complete.values)
            ]
        except ValueError as error:
            raise DataError(f"{topic}: {error}; correct the column map") from None

    return take
