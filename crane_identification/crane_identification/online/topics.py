"""From messages to arrays, and back."""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
from sensor_msgs.msg import JointState

from crane_bags.clocks import NANOSECONDS
from crane_identification.data.column_map import ColumnMap
from crane_identification.online.estimator import Forces, OnlineEstimator
from crane_identification.online.recent import Watched
from crane_identification.online.recursion import Solution
from crane_identification.online.streams import Gathering
from crane_interfaces.msg import CylinderPressures, GeneralizedForces, ParameterEstimate
from crane_model.errors import ConfigurationError, DataError
from crane_nodes.node_time import nanoseconds, stamp_of
from crane_nodes.recording.bag import message_class


class Columns:
    """Picks the joints of the model out of messages of one topic, in whatever order they come."""

    def __init__(self, topic: str, joints: Sequence[str]):
        self._topic = topic
        self._joints = joints
        self._names: Any = None
        self._places = np.empty(0, dtype=int)

    def pick(self, names: Any, field: str, values: Any) -> np.ndarray:
        """(j,) of `values`, one a name; `DataError` if one is missing."""
        if names != self._names:
            missing = [joint for joint in self._joints if joint not in names]
            if missing:
                raise DataError(
                    f"{self._topic}: holds {', '.join(names) or 'no joints'}, but not "
                    f"{', '.join(missing)}, which the model needs"
                )
            self._places = np.array([list(names).index(joint) for joint in self._joints])
            self._names = names
        if len(values) != len(names):
            raise DataError(f"{self._topic}: {len(names)} names, but {len(values)} of {field}")
        return np.asarray(values, dtype=float)[self._places]


class Listener(NamedTuple):
    """Who takes the messages of one topic: `take` is given a message and when it was sent [ns], and
    returns what it completes; `DataError` if something is missing in it.
    """

    topic: str
    msgtype: type[Any]
    take: Callable[[Any, int], list[Forces]]


def listeners(
    estimator: OnlineEstimator | Watched, joint_states: str, pressures: str
) -> tuple[Listener, Listener]:
    """Who passes the messages of the suite's topics on to an estimator."""
    joints = estimator.model.joints
    states, cylinders = Columns(joint_states, joints), Columns(pressures, joints)

    def take_states(message: JointState, sent: int) -> list[Forces]:
        position = states.pick(message.name, "position", message.position)
        return estimator.add_position(nanoseconds(message.header.stamp), position)

    def take_pressures(message: CylinderPressures, sent: int) -> list[Forces]:
        chamber_a = cylinders.pick(message.name, "chamber_a", message.chamber_a)
        chamber_b = cylinders.pick(message.name, "chamber_b", message.chamber_b)
        return estimator.add_pressure(nanoseconds(message.header.stamp), chamber_a, chamber_b)

    return (
        Listener(joint_states, JointState, take_states),
        Listener(pressures, CylinderPressures, take_pressures),
    )


def forces_message(joints: Sequence[str], forces: Forces) -> GeneralizedForces:
    """Measured and predicted forces."""
    message = GeneralizedForces(
        name=list(joints), measured=forces.measured.tolist(), predicted=forces.predicted.tolist()
    )
    message.header.stamp = stamp_of(forces.stamp)
    return message


def estimate_message(estimator: OnlineEstimator, solution: Solution) -> ParameterEstimate:
    """The estimate, with infinite standard deviations where it is not determined."""
    parameters = estimator.model.parameters
    message = ParameterEstimate(
        model=estimator.model.name,
        name=[parameter.name for parameter in parameters],
        value=solution.values.tolist(),
        std_dev=solution.std_devs.tolist(),
        unit=[parameter.unit for parameter in parameters],
        samples=estimator.samples,
    )
    message.header.stamp = stamp_of(estimator.stamp)
    return message


# From messages of topics of any name and type, by their column map, to the estimator.

Feed = tuple[Gathering, Callable[[int, np.ndarray], list[Forces]]]


def mapped_listeners(
    estimator: OnlineEstimator | Watched, column_map: ColumnMap, file: str
) -> tuple[Listener, ...]:
    """Who passes positions and chamber pressures on, a listener of each topic of the map.

    `ConfigurationError` if the map, of `file`, lacks pressures, or the type of a topic.
    """
    joints = column_map.of(estimator.model.joints, file)
    if absent := [
        sources for sources in joints if sources.pressure_a is None or sources.pressure_b is None
    ]:
        name = estimator.model.joints[joints.index(absent[0])]
        raise ConfigurationError(
            f"{file}: key 'joints.{name}': pressure_a and pressure_b are needed: the node computes "
            "forces from them"
        )
    chambers = [
        source
        for side in ("pressure_a", "pressure_b")
        for sources in joints
        if (source := getattr(sources, side))
    ]
    gap = round(estimator.options.largest_gap * NANOSECONDS)
    positions = Gathering([sources.position for sources in joints], gap)
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
