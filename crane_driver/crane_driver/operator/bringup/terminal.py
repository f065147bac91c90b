"""Questions to the operator, answered by lines, while the crane is still being listened to."""

import argparse
import os
import re
import select
import shlex
import sys
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import yaml

from crane_driver.driver_parameters import MAPPING
from crane_driver.operator.bringup.series import STEPS
from crane_model.errors import CraneError, DataError
from crane_nodes.managed import Stop
from crane_nodes.parameters import NodeParameter

# The command lines that the operator is told: the driver and the next step, as they run now.

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


PAUSE = 0.02  # s


class NotConfirmedError(CraneError):
    """The operator did not say yes; the step ends."""


class BringupTerminal:
    """Reads standard input, from a terminal or from a file of answers.

    idle: what is done while waiting, for at most the time it is given [s].
    """

    def __init__(self, stop: Stop, idle: Callable[[float], None]):
        self._stop, self._idle = stop, idle
        self._read = b""

    def say(self, text: str = "") -> None:
        """Print."""
        print(text, flush=True)

    def ask(self, question: str) -> str:
        """The next line; `DataError` if there is none, `KeyboardInterrupt` on a signal."""
        print(f"{question} > ", end="", flush=True)
        while b"\n" not in self._read:
            self._idle(PAUSE)
            if self._stop.requested:
                raise KeyboardInterrupt
            if not select.select([sys.stdin], [], [], 0.0)[0]:
                continue
            part = os.read(sys.stdin.fileno(), 4096)
            if not part:
                raise DataError(f"no answer to '{question}': the input has ended")
            self._read += part
        line, self._read = self._read.split(b"\n", 1)
        if not sys.stdin.isatty():  # so that a log shows question and answer
            print(line.decode(errors="replace"), flush=True)
        return line.decode(errors="replace").strip()

    def number(self, question: str, low: float, high: float) -> float:
        """A number from `low` to `high`; asked again until it is one."""
        while (value := self.number_or_none(question, low, high)) is None:
            self.say("  a number is needed")
        return value

    def number_or_none(self, question: str, low: float, high: float) -> float | None:
        """The same; None where the answer is empty."""
        while answer := self.ask(question):
            try:
                value = float(answer)
            except ValueError:
                self.say(f"  '{answer}' is no number")
                continue
            if low <= value <= high:
                return value
            self.say(f"  {value:g} is not from {low:g} to {high:g}")
        return None

    def confirm(self, question: str) -> None:
        """`NotConfirmedError` unless the answer is yes."""
        if (answer := self.ask(f"{question} Type yes to go on")).casefold() != "yes":
            raise NotConfirmedError(
                f"not confirmed ('{answer}'); the step ends, nothing is written"
            )
