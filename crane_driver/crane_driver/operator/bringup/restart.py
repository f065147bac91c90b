"""The command lines that the operator is told: the driver and the next step, as they run now."""

import argparse
import re
import shlex
from collections.abc import Mapping, Sequence
from pathlib import Path

import yaml

from crane_driver.driver_parameters import MAPPING
from crane_driver.operator.bringup.series import STEPS
from crane_nodes.parameters import NodeParameter

Parameters = Mapping[NodeParameter, str | bool | float]
"""All parameters of the driver and their values."""

LONE_WORDS = re.compile(r"[yYnN~]")  # which ROS takes for a truth value, or for none


def driver_command(now: Parameters, mapping: Path) -> str:
    """The driver with the parameters that it has now, but another mapping."""
    given = {one.name: value for one, value in now.items() if value != one.default}
    given[MAPPING.name] = str(mapping.resolve())
    words = ["ros2", "run", "crane_driver", "driver", "--ros-args"]
    for name, value in given.items():
        words += ["-p", f"{name}:={_as_yaml(value)}"]
    return shlex.join(words)


def next_command(
    parser: argparse.ArgumentParser, options: argparse.Namespace, ros_arguments: Sequence[str]
) -> str | None:
    """The step after the one of `options`, with all of them that are not the default; None after
    the last.

    Without `--mapping`: the next step goes on from the newest one.
    """
    following = STEPS[STEPS.index(options.step) + 1 :]
    if not following:
        return None
    given = {
        name: value for name, value in vars(options).items() if name not in ("step", "mapping")
    }
    words = ["ros2", "run", "crane_driver", "bringup", following[0]]
    for name, value in given.items():
        if value != parser.get_default(name):
            values = value if isinstance(value, list) else [value]
            words += [f"--{name.replace('_', '-')}", *map(str, values)]
    return shlex.join([*words, *ros_arguments])


def _as_yaml(value: str | bool | float) -> str:
    """A value as ROS reads it after `:=`; text in quotes where it would be something else."""
    if isinstance(value, str):
        return value if _is_plain(value) else "'" + value.replace("'", "''") + "'"
    return str(value).lower() if isinstance(value, bool) else repr(value)


def _is_plain(text: str) -> bool:
    """Whether YAML, and the numbers of C, leave it text as it stands."""
    try:
        float(text)
    except ValueError:
        pass
    else:
        return False
    try:
        return yaml.safe_load(text) == text and not LONE_WORDS.fullmatch(text)
    except yaml.YAMLError:
        return False
