"""The command line of a node that is told everything by its parameters."""

import argparse
import sys
import textwrap
from collections.abc import Sequence

from rclpy.utilities import remove_ros_args

from crane_model.cli import command_line
from crane_nodes.parameters import NodeParameter

WIDTH = 98
SIMULATED = "  use_sim_time (default: false)\n      Run on simulated time, which /clock tells"


def check_arguments(
    name: str, about: str, parameters: Sequence[NodeParameter], argv: Sequence[str]
) -> None:
    """Explain the node and end if `argv` asks for it, or holds what is no argument of ROS."""
    parser = command_line(
        prog=name,
        usage=f"{name} [-h] [--ros-args [-p PARAMETER:=VALUE] [--params-file FILE] ...]",
        description=about,
        epilog="\n".join(["parameters:", *map(_entry, parameters), SIMULATED]),
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.parse_args(own_arguments(argv))


def own_arguments(argv: Sequence[str]) -> list[str]:
    """Those that are not for ROS; ends the process where ROS cannot read its own."""
    try:
        return remove_ros_args(["", *argv])[1:]
    except RuntimeError as error:
        reason = str(error).partition(", at ")[0]  # what follows names lines of rcl's sources
        sys.exit(f"error: {reason}")


def ros_arguments(argv: Sequence[str]) -> list[str]:
    """Those that are for ROS: from each --ros-args to the next --, or to the end."""
    found: list[str] = []
    inside = False
    for word in argv:
        inside = inside or word == "--ros-args"
        if inside:
            found.append(word)
        inside = inside and word != "--"
    return found


def _entry(parameter: NodeParameter) -> str:
    text = textwrap.fill(
        parameter.description, WIDTH, initial_indent=" " * 6, subsequent_indent=" " * 6
    )
    return f"  {parameter.name} (default: {_shown(parameter.default)})\n{text}"


def _shown(default: str | bool | float | tuple[float, ...]) -> str:
    """As it is written after `:=`."""
    if isinstance(default, bool):
        return str(default).lower()
    return str(list(default)) if isinstance(default, tuple) else str(default) or "empty"
