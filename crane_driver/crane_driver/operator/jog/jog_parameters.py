"""The parameters of jog."""

from collections.abc import Mapping
from typing import NamedTuple

from rclpy.node import Node

from crane_driver.operator.jog.joystick import Axis, Joystick
from crane_driver.operator.jog.motion import CommandShape
from crane_model.errors import ConfigurationError
from crane_nodes.joint_notes import JointNote
from crane_nodes.parameters import NodeParameter, Number

MAXIMUM = Number("maximum", 0.3, "1", 0.05, 1.0, "Spool command at step 10, or of a full axis")
HOLD = Number("hold", 0.12, "s", 0.05, 0.15, "How long each character of a key holds its joint")
RISE = Number("rise_time", 0.3, "s", 0.05, 5.0, "From neutral to the maximum")
FALL = Number("fall_time", 0.03, "s", 0.01, 0.1, "From the maximum to neutral")
# Left bumper of a game pad, as `joy_node` of ROS has it.
DEADMAN = Number("joy.deadman", 4, "1", 0, 63, "Button to be held, counted from 0", whole=True)


class JogParameters(NamedTuple):
    """Those of each joint, by joint."""

    dead_band: Mapping[str, Number]
    axis: Mapping[str, Number]
    sign: Mapping[str, Number]

    @classmethod
    def of(cls, notes: Mapping[str, JointNote]) -> "JogParameters":
        """For the joints of a machine."""
        dead_band, axis, sign = {}, {}, {}
        for joint, note in notes.items():
            dead_band[joint] = Number(
                f"dead_band.{joint}",
                *(0.05, "1", 0.0, 0.5),
                f"Spool command that does not move {joint} yet",
            )
            axis[joint] = Number(
                f"joy.axis.{joint}",
                *(note.joystick_axis, "1", 0, 63),
                f"Axis of {joint}, counted from 0",
                whole=True,
            )
            sign[joint] = Number(
                f"joy.sign.{joint}",
                *(1, "1", -1, 1),
                f"-1 where the axis of {joint} is reversed",
                whole=True,
            )
        return cls(dead_band, axis, sign)

    @property
    def all(self) -> tuple[NodeParameter, ...]:
        """With those that are of no joint."""
        of_joints = (self.dead_band.values(), (DEADMAN,), self.axis.values(), self.sign.values())
        return (MAXIMUM, HOLD, RISE, FALL, *(one for group in of_joints for one in group))

    def shape(self, node: Node) -> CommandShape:
        """How demands become commands."""
        dead_band = {joint: parameter.read(node) for joint, parameter in self.dead_band.items()}
        return CommandShape(MAXIMUM.read(node), dead_band, RISE.read(node), FALL.read(node))

    def joystick(self, node: Node) -> Joystick:
        """The joystick; `ConfigurationError` where one axis has two joints."""
        axes: dict[str, Axis] = {}
        owners: dict[int, str] = {}
        for joint, parameter in self.axis.items():
            index, sign = int(parameter.read(node)), int(self.sign[joint].read(node))
            if index in owners:
                raise ConfigurationError(
                    f"parameter '{parameter.name}': axis {index} is that of {owners[index]} already"
                )
            if not sign:
                raise ConfigurationError(
                    f"parameter '{self.sign[joint].name}': must be -1 or 1, got 0"
                )
            owners[index] = joint
            axes[joint] = Axis(index, sign)
        return Joystick(int(DEADMAN.read(node)), axes)
