"""What every step of a bring-up works with."""

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from matplotlib.figure import Figure

from crane_driver.can.layout import Layout
from crane_driver.can.mapping import PositionSignal
from crane_driver.operator.bringup.crane_client import CraneClient
from crane_driver.operator.bringup.motion import Mover, StoppedError
from crane_driver.operator.bringup.samples import ROTARY, Rest, at_rest
from crane_driver.operator.bringup.series import MAPPING, Series, copy_changed
from crane_driver.operator.bringup.terminal import BringupTerminal, Parameters, driver_command
from crane_nodes.joint_notes import JointNote

REPEATS = 5  # of one ramp
Done = TypeVar("Done")


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


@dataclass(frozen=True)
class Bench:
    """The crane, the operator, and where results go."""

    crane: CraneClient
    terminal: BringupTerminal
    series: Series
    mapping: Path  # that the driver runs with
    driver: Parameters  # with which the driver runs
    positions: Mapping[str, PositionSignal]  # of that mapping
    layout: Layout
    units: Mapping[str, str]  # of all joints of the machine
    notes: Mapping[str, JointNote]  # of them as well
    joints: tuple[str, ...]  # to be measured
    protocol: Protocol

    def rests(self) -> list[Rest]:
        """All joints of the driver, which stand, from now on."""
        positions = self.crane.record(self.protocol.seconds)
        time = np.array([one.time for one in self.crane.samples])
        return [
            at_rest(
                joint,
                time,
                positions[:, i],
                self.layout.resolution(joint),
                ROTARY if self.units[joint] == "rad" else None,
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
        """What a ramp of a joint gives; if a stall or the driver cuts it off, it alone is repeated.

        A fault of the driver is reset when the operator agrees, and not before.
        """
        for _ in range(REPEATS):
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
        self, step: str, results: Mapping[str, Any], figure: Figure, **protocol: float
    ) -> Path:
        """Write result and picture; the folder."""
        run = self.series.write(step, self.mapping, protocol, results, figure)
        self.terminal.say(f"result: {run}")
        return run

    def new_mapping(self, run: Path, change: Callable[[Any], None]) -> None:
        """A mapping beside the results of a step; the one of the driver stays as it is."""
        target = run / MAPPING
        copy_changed(self.mapping, target, change, f"{run.name}, measured on {self.mapping}")
        self.terminal.say(
            "restart the driver with the new mapping before the next step:\n"
            f"  {driver_command(self.driver, target)}"
        )
