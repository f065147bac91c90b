"""The parameters of jog."""

from rclpy.node import Node

from crane_driver.operator.jog.joystick import Axis, Joystick
from crane_driver.operator.jog.motion import CommandShape
from crane_model.errors import ConfigurationError
from crane_model.machine import JOINTS
from crane_nodes.parameters import Number

# What `joy_node` of ROS makes of a game pad: left stick 0, 1; right stick 3, 4; left bumper 4.
AXES = {"slew": 0, "inner_boom": 4, "outer_boom": 1, "telescope": 3}

MAXIMUM = Number("maximum", 0.3, "1", 0.05, 1.0, "Spool command at step 10, or of a full axis")
HOLD = Number("hold", 0.12, "s", 0.05, 0.15, "How long each character of a key holds its joint")
RISE = Number("rise_time", 0.3, "s", 0.05, 5.0, "From neutral to the maximum")
FALL = Number("fall_time", 0.03, "s", 0.01, 0.1, "From the maximum to neutral")
DEAD_BAND = {
    joint: Number(
        f"dead_band.{joint}", 0.05, "1", 0.0, 0.5, f"Spool command that does not move {joint} yet"
    )
    for joint in JOINTS
}
DEADMAN = Number("joy.deadman", 4, "1", 0, 63, "Button to be held, counted from 0", whole=True)
AXIS = {
    joint: Number(
        f"joy.axis.{joint}", index, "1", 0, 63, f"Axis of {joint}, counted from 0", whole=True
    )
    for joint, index in AXES.items()
}
SIGN = {
    joint: Number(
        f"joy.sign.{joint}", 1, "1", -1, 1, f"-1 where the axis of {joint} is reversed", whole=True
    )
    for joint in JOINTS
}
PARAMETERS = (MAXIMUM, HOLD, RISE, FALL, *DEAD_BAND.values(), DEADMAN, *AXIS.values(),
              *SIGN.values())  # fmt: skip


def shape(node: Node) -> CommandShape:
    """How demands become commands."""
    dead_band = {joint: parameter.read(node) for joint, parameter in DEAD_BAND.items()}
    return CommandShape(MAXIMUM.read(node), dead_band, RISE.read(node), FALL.read(node))


def joystick(node: Node) -> Joystick:
    """The joystick; `ConfigurationError` where one axis has two joints."""
    axes: dict[str, Axis] = {}
    owners: dict[int, str] = {}
    for joint, parameter in AXIS.items():
        index, sign = int(parameter.read(node)), int(SIGN[joint].read(node))
        if index in owners:
            raise ConfigurationError(
                f"parameter '{parameter.name}': axis {index} is that of {owners[index]} already"
            )
        if not sign:
            raise ConfigurationError(f"parameter '{SIGN[joint].name}': must be -1 or 1, got 0")
        owners[index] = joint
        axes[joint] = Axis(index, sign)
    return Joystick(int(DEADMAN.read(node)), axes)
