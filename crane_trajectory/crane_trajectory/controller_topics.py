"""Which controller leads the crane, the chamber pressures that it is shown, and the load."""

from dataclasses import replace
from pathlib import Path

import numpy as np
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.subscription import Subscription

from crane_interfaces.msg import CylinderPressures, TipLoad
from crane_model.errors import ConfigurationError
from crane_model.machine import Machine
from crane_model.model_file import Model, load_model, save_model
from crane_nodes.node_time import NodeTime
from crane_nodes.stamps import nanoseconds
from crane_trajectory.control.choice import PD_DEAD_ZONE, controller, learning, led_by_model
from crane_trajectory.control.controller import GainArrays
from crane_trajectory.control.interface import (
    ChamberPressures,
    Controller,
    Point,
    SensorReading,
    Wanted,
)
from crane_trajectory.control.learning import Learning
from crane_trajectory.control.learnt import in_words, learnt_hydraulics
from crane_trajectory.control.tip_load import FedLoad, ToldLoad
from crane_trajectory.control.tuning import Tuning
from crane_trajectory.motion.periodic import PeriodicTrajectory
from crane_trajectory.trajectory_parameters import (
    FEEDBACK_SCALE,
    LARGEST_TIP_LOAD,
    LAW,
    LEARNING,
    MODEL,
)

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
