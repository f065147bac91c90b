"""The operator's terminal, and the bench that every step of a bring-up works with."""

import argparse
import os
import re
import select
import shlex
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
import yaml

from crane_driver import constants
from crane_driver.can.mapping import PositionSignal
from crane_driver.driver_parameters import MAPPING
from crane_driver.operator.bringup.crane_client import CraneClient
from crane_driver.operator.bringup.estimates import ENCODER_TURN_RAD, Rest, at_rest
from crane_driver.operator.bringup.motion import Mover, StoppedError
from crane_driver.operator.bringup.results import MAPPING_FILE, STEPS, Series, copy_changed
from crane_model.errors import CraneError, DataError
from crane_nodes.joint_notes import JointNote
from crane_nodes.managed import Stop
from crane_nodes.parameters import NodeParameter

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from crane_driver.can.layout import Layout

Parameters = Mapping[NodeParameter, str | bool | float]
"""All parameters of the driver and their values."""

LONE_WORDS = re.compile(r"[yYnN~]")  # which ROS takes for a truth value, or for none


@dataclass(frozen=True)
class Protocol:
    """How it is measured; the options of the same names say more."""

    seconds: float  # s, of a record at rest
    rate: float  # 1/s, of the command
    speed: float  # rad/s, m/s
    limit: float  # of the command
    travel: float  # rad, m
    repeats: int
    time_constant: float  # s, of the closed loop


@dataclass(frozen=True, kw_only=True)
class BringupRequest(Protocol):
    """Request of the command line."""

    step: str
    out: Path  # folder of the bring-up
    mapping: Path | None  # to go on from; None: the newest of the folder
    joints: Sequence[str]  # empty: all
    controller: Path | None  # file to begin from; None: that of the machine
    rehearsal: Path  # folder of the rehearsal


def driver_command(now: Parameters, mapping: Path) -> str:
    """The driver with the parameters that it has now, but another mapping."""
    given = {
        parameter.name: value for parameter, value in now.items() if value != parameter.default
    }
    given[MAPPING.name] = str(mapping.resolve())
    words = ["ros2", "run", "crane_driver", "driver", "--ros-args"]
    for name, value in given.items():
        words += ["-p", f"{name}:={_as_yaml(value)}"]
    return shlex.join(words)


def next_command(
    parser: argparse.ArgumentParser, request: BringupRequest, ros_arguments: Sequence[str]
) -> str | None:
    """Command of the step after the one of `request`, with all options that are not the default;
    None after the last step.

    Without `--mapping`: the next step goes on from the newest one.
    """
    following = STEPS[STEPS.index(request.step) + 1 :]
    if not following:
        return None
    words = ["ros2", "run", "crane_driver", "bringup", following[0]]
    for name, value in vars(request).items():
        if name not in ("step", "mapping") and value != parser.get_default(name):
            values = value if isinstance(value, list) else [value]
            words += [f"--{name.replace('_', '-')}", *map(str, values)]
    return shlex.join([*words, *ros_arguments])


def _as_yaml(value: str | bool | float) -> str:
    """A value as ROS reads it after `:=`; text in quotes where it would be something else."""
    if isinstance(value, str):
        return value if _is_plain(value) else "'" + value.replace("'", "''") + "'"
    return str(value).lower() if isinstance(value, bool) else repr(value)


def _is_plain(text: str) -> bool:
    """Return whether YAML, and the numbers of C, leave it text as it stands."""
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
        print(text, flush=True)

    def ask(self, question: str) -> str:
        print(f"{question} > ", end="", flush=True)
        while b"\n" not in self._read:
            self._idle(constants.ANSWER_POLL_S)
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
        while answer := self.ask(question):
            try:
                value = float(answer)
            except ValueError:
                self.say(f"  '{answer}' is not a number")
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


Done = TypeVar("Done")


@dataclass(frozen=True)
class Bench:
    """The crane, the operator, and where results go."""

    crane: CraneClient
    terminal: BringupTerminal
    series: Series
    mapping: Path  # that the driver runs with
    driver: Parameters  # with which the driver runs
    positions: Mapping[str, PositionSignal]  # of that mapping
    layout: "Layout"
    units: Mapping[str, str]  # of all joints of the machine
    notes: Mapping[str, JointNote]  # of them as well
    joints: tuple[str, ...]  # to be measured
    protocol: Protocol

    def rests(self) -> list[Rest]:
        positions = self.crane.record(self.protocol.seconds)
        time = np.array([sample.time for sample in self.crane.samples])
        return [
            at_rest(
                joint,
                time,
                positions[:, i],
                self.layout.resolution(joint),
                ENCODER_TURN_RAD if self.units[joint] == "rad" else None,
            )
            for i, joint in enumerate(self.crane.joints)
        ]

    @contextmanager
    def moving(self, joint: str) -> Iterator[Mover]:
        """One joint in the hands of the program; however the block is left, it ends at neutral."""
        rests = self.rests()
        with self.crane.drive(joint) as drive:
            yield Mover(drive, self.crane.joints, joint, rests, self.protocol.travel)

    def driven(self, mover: Mover, ramp: Callable[[Mover], Done]) -> Done:
        """Drive a ramp of a joint; repeat it alone if a stall or the driver cuts it off.

        A fault of the driver is reset only after the operator agrees.
        """
        for _ in range(constants.RAMP_REPEATS):
            try:
                return ramp(mover)
            except StoppedError as error:
                self.terminal.say(f"  {error}; only this ramp of {mover.joint} is repeated")
                mover.drive.leave()
                if trouble := self.crane.trouble:
                    self.terminal.confirm(
                        f"  {mover.joint}: stopped by the driver: {trouble}. See that the crane is "
                        "well. Reset the fault and repeat this ramp?"
                    )
                    mover.drive.recover()
        return ramp(mover)

    def finish(
        self, step: str, results: Mapping[str, Any], figure: "Figure", **protocol: float
    ) -> Path:
        run = self.series.write(step, self.mapping, protocol, results, figure)
        self.terminal.say(f"result: {run}")
        return run

    def new_mapping(self, run: Path, change: Callable[[Any], None]) -> None:
        """A mapping beside the results of a step; the one of the driver stays as it is."""
        target = run / MAPPING_FILE
        copy_changed(self.mapping, target, change, f"{run.name}, measured on {self.mapping}")
        self.terminal.say(
            "restart the driver with the new mapping before the next step:\n"
            f"  {driver_command(self.driver, target)}"
        )
