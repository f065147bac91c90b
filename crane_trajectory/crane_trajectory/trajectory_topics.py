"""The topics of the trajectory node: joint states, references, valve commands, pressures, load."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
from builtin_interfaces.msg import Time
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile
from rclpy.subscription import Subscription
from sensor_msgs.msg import JointState

from crane_interfaces.action import RunExcitation
from crane_interfaces.msg import CylinderPressures, JointReference, TipLoad, ValveCommand
from crane_model.errors import ConfigurationError, DataError
from crane_model.machine import Machine
from crane_model.model_file import Model, load_model, save_model
from crane_nodes.names import full_name, publishers
from crane_nodes.node_time import NodeTime, nanoseconds
from crane_trajectory.control.choice import PD_DEAD_ZONE, controller, learning, led_by_model
from crane_trajectory.control.interface import (
    ChamberPressures,
    Controller,
    Point,
    SensorReading,
    Wanted,
)
from crane_trajectory.control.learning import Learning, in_words, learnt_hydraulics
from crane_trajectory.control.load import FedLoad, ToldLoad
from crane_trajectory.control.pd_dead_zone import GainArrays, Tuning
from crane_trajectory.experiment import Experiment, Outcome
from crane_trajectory.motion.motion import Phase, Target
from crane_trajectory.motion.periodic import PeriodicTrajectory
from crane_trajectory.trajectory_parameters import (
    FEEDBACK_SCALE,
    LARGEST_TIP_LOAD,
    LAW,
    LEARNING,
    MODEL,
)

# Joint states as arrays; references, commands and results as messages.


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


# Who commands the valves: this node while it leads the crane, and no other meanwhile.

TOPIC = "valve_command"


class Valves:
    """The topic valve_command of `node`, on which it publishes from `open` to `close`."""

    def __init__(self, node: Node, clock: NodeTime, joints: Sequence[str]):
        self._node, self._clock, self._joints = node, clock, joints
        self._publisher: Publisher | None = None

    def open(self) -> None:
        """Be the one who commands the valves."""
        self._publisher = self._node.create_publisher(ValveCommand, TOPIC, self._clock.depth)

    def close(self) -> None:
        """Command the valves no more."""
        if self._publisher is not None:
            self._node.destroy_publisher(self._publisher)
            self._publisher = None

    def send(self, u: np.ndarray | None) -> None:
        """Spool commands (j,), between -1 and 1; None where there are none to send."""
        if u is not None and self._publisher is not None:
            self._publisher.publish(command_message(u, self._clock.stamp(), self._joints))

    @property
    def rivals(self) -> str:
        """Who else may command the valves, and what to do; empty if nobody does."""
        others = [one for one in publishers(self._node, TOPIC) if one != full_name(self._node)]
        if not others:
            return ""
        return f"{', '.join(others)} may command the valves, only one may; stop it"

    @property
    def unheard(self) -> str:
        """Where nobody listens to the commands; empty if the driver does, or none are sent."""
        if self._publisher is None or self._publisher.get_subscription_count():
            return ""
        return f"no driver listens to {self._publisher.topic_name}"


# Which controller leads the crane, the chamber pressures that it is shown, and the load.

OLDEST = 0.05  # s, of pressures that are shown; older ones are lost
NEWEST = QoSProfile(depth=1)


class Leading:
    """The parameters `law` and `model` of a node, the topics cylinder_pressures and tip_load."""

    def __init__(self, node: Node, clock: NodeTime):
        self._node, self._clock = node, clock
        self._joints: tuple[str, ...] = ()
        self._subscriptions: list[Subscription] = []
        self._newest: ChamberPressures | None = None
        self._heard = -np.inf
        self._model: Model | None = None
        self._load: FedLoad | None = None  # where tip_load is to be used
        self._learnt: Learning | None = None
        self._of: PeriodicTrajectory | None = None  # which `_learnt` has learnt
        self.law = PD_DEAD_ZONE
        self.controller: Controller | None = None  # (36) with gains that may change

    def configure(self, machine: Machine, gains: GainArrays) -> None:
        """Make the controller, compiled; `ConfigurationError` if what it needs is unknown."""
        self._joints, self.law = machine.joint_names, LAW.read(self._node)
        path = MODEL.read(self._node)
        self._model = load_model(path) if path else None
        scale = FEEDBACK_SCALE.read(self._node)
        made = controller(self.law, machine, gains, self._model, scale)
        if LEARNING.read(self._node):
            learning(self.law, made, period=1.0)  # refused here, not while a goal begins
        heaviest = LARGEST_TIP_LOAD.read(self._node)
        if heaviest and led_by_model(made) is None:
            raise ConfigurationError(
                f"parameter 'largest_tip_load': law {self.law} leads by no load, so that tip_load "
                "is of no use to it; use another law, or leave it 0"
            )
        self._load = FedLoad(heaviest) if heaviest else None
        self.controller = None if self.law == PD_DEAD_ZONE else made
        self._of = self._learnt = None
        limits = [machine.limits[joint] for joint in self._joints]
        middle = np.array([(one.position_min + one.position_max) / 2.0 for one in limits])
        rest = Point(middle, np.zeros_like(middle), np.zeros_like(middle))
        made.start(np.zeros_like(middle))
        nothing = ChamberPressures.none(len(middle))
        made.command(
            0.0, SensorReading(middle, np.zeros_like(middle), *nothing), Wanted(rest, rest)
        )

    def tightened(self, tuning: Tuning) -> Tuning:
        """The tuning with the tolerances that the controller allows."""
        return tuning if self.controller is None else tuning.tightened(self.controller.by_model)

    def leader(self, trajectory: PeriodicTrajectory) -> Controller | None:
        """The controller, which learns the trajectory from goal to goal where it is to."""
        if self.controller is None or not LEARNING.read(self._node):
            return self.controller
        if self._learnt is None or self._of != trajectory:
            self._learnt = learning(self.law, self.controller, trajectory.period)
            self._of = trajectory
        return self._learnt

    @property
    def learnt(self) -> dict[str, str]:
        """What an adaptive controller has learnt, in words; empty for others."""
        led = led_by_model(self.controller)
        return dict(in_words(led)) if led is not None and led.adaptive else {}

    def save_learnt(self, file: Path) -> None:
        """Write the model with what was learnt; `ConfigurationError` if nothing is."""
        led = led_by_model(self.controller)
        if led is None or not led.adaptive or self._model is None:
            raise ConfigurationError(
                f"nothing to save: law {self.law} learns no dead zones and gains, adaptive_flow "
                "does"
            )
        assert self._model.hydraulics is not None  # `controller` saw to it
        values = learnt_hydraulics(self._model.hydraulics, led)
        save_model(file, replace(self._model, hydraulics=values))

    def listen(self) -> None:
        """To the pressures, where a controller may use them, and to the load, where it is to."""
        listen = self._node.create_subscription
        if self.controller is not None:
            self._subscriptions = [
                listen(CylinderPressures, "cylinder_pressures", self._take, NEWEST)
            ]
        if self._load is not None:  # not latched: a load of before is of no use
            self._subscriptions.append(listen(TipLoad, "tip_load", self._weighed, NEWEST))

    def silence(self) -> None:
        """Listen no more."""
        for one in self._subscriptions:
            self._node.destroy_subscription(one)
        self._subscriptions = []
        self._newest = None

    @property
    def load(self) -> dict[str, str]:
        """What the crane is led with, in words; empty where tip_load is not used."""
        return {"load at the tip [kg]": f"{self._load.mass:.1f}"} if self._load else {}

    def sensed(self, stamp: float) -> ChamberPressures | None:
        """The newest pressures, None where they are too old. The crane is led from now on with the
        load that is believed at the `stamp` [s] of a joint state.
        """
        if self._load is not None and (led := led_by_model(self.controller)) is not None:
            led.carry(self._load.at(stamp))
        return self._newest if self._clock.now() - self._heard < OLDEST else None

    def _take(self, message: CylinderPressures) -> None:
        taken = ChamberPressures.none(len(self._joints))
        chambers = zip(message.name, message.chamber_a, message.chamber_b, strict=False)
        a, b = taken.a.copy(), taken.b.copy()
        for joint, in_a, in_b in chambers:
            if joint in self._joints:
                place = self._joints.index(joint)
                a[place], b[place] = in_a, in_b
        self._newest = ChamberPressures(a, b, message.supply)
        self._heard = self._clock.of(message.header.stamp)

    def _weighed(self, message: TipLoad) -> None:
        assert self._load is not None
        stamp = 1e-9 * nanoseconds(message.header.stamp)
        self._load.tell(ToldLoad(stamp, message.load, message.std_dev, message.condition))
