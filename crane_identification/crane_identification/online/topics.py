"""From messages to arrays, and back."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from builtin_interfaces.msg import Time
from sensor_msgs.msg import JointState

from crane_identification.online.estimator import Forces, OnlineEstimator
from crane_identification.online.recent import Recent
from crane_identification.online.recursion import Solution
from crane_identification.online.smoother import NANOSECONDS
from crane_interfaces.msg import CylinderPressures, GeneralizedForces, ParameterEstimate
from crane_model.errors import DataError


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


class Feed:
    """Passes the messages of both topics on to an estimator, and to what checks them."""

    def __init__(
        self, estimator: OnlineEstimator, recent: Recent, joint_states: str, pressures: str
    ):
        self._estimator, self._recent = estimator, recent
        joints = estimator.model.joints
        self._states = Columns(joint_states, joints)
        self._pressures = Columns(pressures, joints)

    def joint_states(self, message: JointState) -> list[Forces]:
        """What the positions of a message complete; `DataError` if a joint is missing."""
        position = self._states.pick(message.name, "position", message.position)
        stamp = nanoseconds(message.header.stamp)
        self._recent.add_position(stamp, position)
        return self._estimator.add_position(stamp, position)

    def pressures(self, message: CylinderPressures) -> list[Forces]:
        """What the pressures of a message complete; `DataError` if a cylinder is missing."""
        chamber_a = self._pressures.pick(message.name, "chamber_a", message.chamber_a)
        chamber_b = self._pressures.pick(message.name, "chamber_b", message.chamber_b)
        stamp = nanoseconds(message.header.stamp)
        self._recent.add_pressure(stamp, chamber_a, chamber_b)
        return self._estimator.add_pressure(stamp, chamber_a, chamber_b)


def nanoseconds(stamp: Time) -> int:
    """A stamp as one number."""
    return stamp.sec * NANOSECONDS + stamp.nanosec


def forces_message(joints: Sequence[str], forces: Forces) -> GeneralizedForces:
    """Measured and predicted forces."""
    message = GeneralizedForces(
        name=list(joints), measured=forces.measured.tolist(), predicted=forces.predicted.tolist()
    )
    message.header.stamp = _stamp(forces.stamp)
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
    message.header.stamp = _stamp(estimator.stamp)
    return message


def _stamp(stamp: int) -> Time:
    seconds, nanosec = divmod(stamp, NANOSECONDS)
    return Time(sec=seconds, nanosec=nanosec)
