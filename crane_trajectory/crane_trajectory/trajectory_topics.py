"""Joint states as arrays; references, commands and results as messages."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from builtin_interfaces.msg import Time
from rclpy.node import Node
from sensor_msgs.msg import JointState

from crane_interfaces.action import RunExcitation
from crane_interfaces.msg import JointReference, ValveCommand
from crane_model.errors import DataError
from crane_nodes.publishers import publishers
from crane_trajectory.experiment import Experiment, Outcome
from crane_trajectory.motion.motion import Phase
from crane_trajectory.motion.reference_clock import Target


class MeasuredJoints(NamedTuple):
    """One joint state: (j,) in the order of the joints that were asked for [SI]."""

    stamp: Time
    position: np.ndarray
    velocity: np.ndarray

    @property
    def seconds(self) -> float:
        """The stamp [s]."""
        return self.stamp.sec + self.stamp.nanosec * 1e-9


def sample(message: JointState, joints: Sequence[str]) -> MeasuredJoints:
    """The `joints` of a joint state; `DataError` if one is missing."""
    names = list(message.name)
    if missing := [joint for joint in joints if joint not in names]:
        raise DataError(
            f"joint states: {', '.join(missing)} missing, {', '.join(joints)} are needed"
        )
    if not len(names) == len(message.position) == len(message.velocity):
        raise DataError("joint states: a position and a velocity are needed for every name")
    places = [names.index(joint) for joint in joints]
    return MeasuredJoints(
        message.header.stamp,
        np.asarray(message.position, dtype=float)[places],
        np.asarray(message.velocity, dtype=float)[places],
    )


def several_sources(node: Node) -> str:
    """Who publishes joint states, if several do, as a player of bags might; else empty."""
    if node.count_publishers("joint_states") < 2:
        return ""
    names, topic = publishers(node, "joint_states"), node.resolve_topic_name("joint_states")
    return f"{', '.join(names)} publish {topic}, only the driver may; stop the others"


def reference_message(target: Target, stamp: Time, joints: Sequence[str]) -> JointReference:
    """A message of joint_reference, for the time of the joint state that it is compared with."""
    message = JointReference(
        name=list(joints),
        position=target.position.tolist(),
        velocity=target.velocity.tolist(),
        acceleration=target.acceleration.tolist(),
    )
    message.header.stamp = stamp
    return message


def command_message(command: np.ndarray, stamp: Time, joints: Sequence[str]) -> ValveCommand:
    """A message of valve_command."""
    message = ValveCommand(name=list(joints), command=command.tolist())
    message.header.stamp = stamp
    return message


def feedback_message(experiment: Experiment) -> RunExcitation.Feedback:
    """Where the experiment is."""
    phase = Phase.REST if experiment.target is None else experiment.target.phase
    if phase is Phase.REST:  # before the motion, or after it
        phase = Phase.APPROACH if experiment.elapsed == 0.0 else Phase.STOP
    units = experiment.motion.machine.units
    return RunExcitation.Feedback(
        phase=int(phase),
        elapsed=experiment.elapsed,
        duration=experiment.motion.duration,
        name=list(units),
        unit=list(units.values()),
        tracking_error=experiment.tracking_error.tolist(),
    )


def result_message(
    outcome: Outcome, message: str, units: Mapping[str, str], rms: np.ndarray | None = None
) -> RunExcitation.Result:
    """How a goal has ended; `units` of the joints are those of their machine."""
    rms = np.full(len(units), np.nan) if rms is None else rms
    return RunExcitation.Result(
        outcome=int(outcome),
        message=message,
        name=list(units),
        unit=list(units.values()),
        rms_tracking_error=rms.tolist(),
    )
