"""The printed command lines, given to a shell and to those who read them."""

import shlex
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest
import rclpy
from rclpy.node import Node

from crane_driver.driver_parameters import driver_parameters
from crane_driver.operator.bringup.bench import (
    BringupRequest,
    Parameters,
    driver_command,
    next_command,
)
from crane_driver.operator.bringup.main import command_parser
from crane_model import load_machine
from crane_nodes import declare
from crane_nodes.managed import own_arguments, ros_arguments

PARAMETERS = driver_parameters(load_machine(), "laboratory_crane")
DEFAULTS = {one.name: one.default for one in PARAMETERS}
NAMES = ("it's here", "a: b", "# no remark", "two  blanks $HOME `ls` \\", "é&|;<>*?", '"double"')
LIKE_OTHERS = ("yes", "y", "1e3", "0x10", "nan", "null", "~", "[1, 2]", "1", ".inf", "- a", "")


def by_shell(command: str) -> list[str]:
    """The words of a command line as a shell hands them over."""
    words = f'{shlex.quote(sys.executable)} -c "import sys; print(*sys.argv[1:], sep=chr(0))"'
    given = subprocess.run(
        ["sh", "-c", f"{words} {command}"], capture_output=True, text=True, check=True
    )
    return given.stdout.removesuffix("\n").split("\0")


def running(values: Mapping[str, Any]) -> Parameters:
    """The driver's parameters from their values by name."""
    return {one: values[one.name] for one in PARAMETERS}


def started(command: str, domain: int) -> dict[str, object]:
    """The parameters of a node that is started by a command line."""
    words = by_shell(command)
    assert words[:4] == ["ros2", "run", "crane_driver", "driver"]
    context = rclpy.Context()
    rclpy.init(args=words[4:], context=context, domain_id=domain)
    try:
        node = Node("driver", context=context, start_parameter_services=False)
        declare(node, PARAMETERS)
        values = {one.name: node.get_parameter(one.name).value for one in PARAMETERS}
        node.destroy_node()
        return values
    finally:
        context.shutdown()


def test_the_driver_is_started_again_with_all_that_it_has(ros_domain: int) -> None:
    values = DEFAULTS | {
        "bus.interface": "socketcan",
        "bus.channel": "can0",
        "bus.bitrate": 500_000,
        "bus.options": "port=43113 fd=false",
        "dbc": "/mine/crane 2.dbc",
        "machine": "/mine/machine.yaml",
        "safety": "/mine/safety.yaml",
        "mapping": "/mine/mapping.yaml",
        "jerk_density.slew": 0.25,
        "autostart": False,
    }
    command = driver_command(running(values), Path("/new/mapping.yaml"))
    assert started(command, ros_domain) == values | {"mapping": "/new/mapping.yaml"}
    assert "jerk_density.telescope" not in command


@pytest.mark.parametrize("names", [NAMES, LIKE_OTHERS])
def test_every_name_passes_the_shell_and_ros_as_it_is(
    names: tuple[str, ...], ros_domain: int
) -> None:
    texts = ("bus.interface", "bus.channel", "bus.options", "dbc", "machine", "safety")
    for first in range(0, len(names), len(texts)):
        values = DEFAULTS | dict(zip(texts, names[first:], strict=False))
        command = driver_command(running(values), Path("/m.yaml"))
        assert started(command, ros_domain) == values | {"mapping": "/m.yaml"}


def test_the_next_step_keeps_every_option() -> None:
    given = [
        *("encoders", "--out", "runs/the crane's", "--joints", "slew", "telescope"),
        *("--travel", "0.05", "--speed", "0.02", "--limit", "0.3", "--rate", "0.1"),
        *("--seconds", "0.5", "--repeats", "2", "--time-constant", "0.4"),
        *("--controller", "mine/controller.yaml"),
    ]
    of_ros = ["--ros-args", "-r", "__ns:=/left"]
    parser = command_parser()
    options = parser.parse_args(given)
    command = next_command(
        parser, BringupRequest(**vars(options)), ros_arguments([*given, *of_ros])
    )
    assert command
    words = by_shell(command)
    assert words[:4] == ["ros2", "run", "crane_driver", "bringup"]
    assert ros_arguments(words) == of_ros
    assert vars(parser.parse_args(own_arguments(words[4:]))) == vars(options) | {
        "step": "pressures"
    }


def test_the_next_step_goes_on_from_the_mapping_that_was_measured() -> None:
    parser = command_parser()
    options = parser.parse_args(["encoders", "--out", "runs/a", "--mapping", "naive.yaml"])
    command = next_command(parser, BringupRequest(**vars(options)), [])
    assert command == "ros2 run crane_driver bringup pressures --out runs/a"


def test_nothing_follows_the_gains() -> None:
    parser = command_parser()
    options = parser.parse_args(["dead_band", "--out", "runs/a"])
    command = next_command(parser, BringupRequest(**vars(options)), [])
    assert command
    following = parser.parse_args(by_shell(command)[4:])
    assert following.step == "gains"
    assert next_command(parser, BringupRequest(**vars(following)), []) is None
