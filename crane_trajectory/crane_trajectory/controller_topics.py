"""Which controller leads the crane, and the chamber pressures that it is shown."""

import time

import numpy as np
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.subscription import Subscription

from crane_interfaces.msg import CylinderPressures
from crane_model.machine import Machine
from crane_model.model_file import load_model
from crane_trajectory.control.choice import PD_DEAD_ZONE, controller
from crane_trajectory.control.controller import GainArrays
from crane_trajectory.control.interface import (
    ChamberPressures,
    Controller,
    Point,
    SensorReading,
    Wanted,
)
from crane_trajectory.trajectory_parameters import LAW, MODEL

OLDEST = 0.05  # s, of pressures that are shown; older ones are lost
NEWEST = QoSProfile(depth=1)


class Leading:
    """The parameters `law` and `model` of a node, and the topic cylinder_pressures."""

    def __init__(self, node: Node):
        self._node = node
        self._joints: tuple[str, ...] = ()
        self._subscription: Subscription | None = None
        self._newest: ChamberPressures | None = None
        self._heard = -np.inf
        self.law = PD_DEAD_ZONE
        self.controller: Controller | None = None  # (36) with gains that may change

    def configure(self, machine: Machine, gains: GainArrays) -> None:
        """Make the controller, compiled; `ConfigurationError` if what it needs is unknown."""
        self._joints, self.law = machine.joint_names, LAW.read(self._node)
        path = MODEL.read(self._node)
        model = load_model(path) if path else None
        made = controller(self.law, machine, gains, model)
        self.controller = None if self.law == PD_DEAD_ZONE else made
        limits = [machine.limits[joint] for joint in self._joints]
        middle = np.array([(one.position_min + one.position_max) / 2.0 for one in limits])
        rest = Point(middle, np.zeros_like(middle), np.zeros_like(middle))
        made.start(np.zeros_like(middle))
        nothing = ChamberPressures.none(len(middle))
        made.command(
            0.0, SensorReading(middle, np.zeros_like(middle), *nothing), Wanted(rest, rest)
        )

    def listen(self) -> None:
        """To the pressures, where a controller may use them."""
        if self.controller is not None:
            self._subscription = self._node.create_subscription(
                CylinderPressures, "cylinder_pressures", self._take, NEWEST
            )

    def silence(self) -> None:
        """Listen no more."""
        if self._subscription is not None:
            self._node.destroy_subscription(self._subscription)
            self._subscription = None
        self._newest = None

    @property
    def pressures(self) -> ChamberPressures | None:
        """The newest, None where they are too old."""
        return self._newest if time.monotonic() - self._heard < OLDEST else None

    def _take(self, message: CylinderPressures) -> None:
        taken = ChamberPressures.none(len(self._joints))
        chambers = zip(message.name, message.chamber_a, message.chamber_b, strict=False)
        a, b = taken.a.copy(), taken.b.copy()
        for joint, in_a, in_b in chambers:
            if joint in self._joints:
                place = self._joints.index(joint)
                a[place], b[place] = in_a, in_b
        self._newest, self._heard = ChamberPressures(a, b, message.supply), time.monotonic()
