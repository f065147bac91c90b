"""A crane that is wired otherwise than its mapping says, its operator, and `bringup` beside it."""

import math
import os
import select
import shlex
import subprocess
import time
from collections.abc import Callable
from pathlib import Path

import yaml
from integration.processes import (
    DRIVER,
    MACHINE,
    PATIENCE,
    RUN,
    SIMULATED_TIME,
    end,
    environment,
    free_port,
    line,
    start,
)

from crane_bags.clocks import NANOSECONDS
from crane_driver import BusSettings, DriverCodec, Link, MachineCodec, load_layout
from crane_driver.can.frame import TIME, told_time
from crane_model import load_machine
from crane_model.machine_files import machine_file

BRINGUP = RUN.format(module="crane_driver.operator.bringup.main")
WIRING = {  # (sign, zero) of encoders, sign of valves
    "positions": {"inner_boom": (-1, 0.3), "outer_boom": (1, -0.2)},
    "commands": {"inner_boom": 1, "outer_boom": -1},
}
OFFSETS = {"inner_boom.a": 2.5e5, "outer_boom.b": 1.2e5, "tank": 0.8e5}  # Pa
VALVES = {  # dead bands +0.085 and -0.055; +0.06 and -0.10
    "inner_boom": {"dead_band": 0.07, "null_bias": 0.015},
    "outer_boom": {"dead_band": 0.08, "null_bias": -0.02},
}


class Workshop:
    """The crane, a driver that can be given another mapping, and the operator's eyes and hands."""

    def __init__(self, folder: Path):
        self.folder = folder
        naive = yaml.safe_load(machine_file("can.yaml").read_text())
        self.naive = folder / "naive.yaml"
        self.naive.write_text(yaml.safe_dump(naive))
        for joint, (sign, zero) in WIRING["positions"].items():
            naive["positions"][joint] |= {"sign": sign, "zero": zero}
        for joint, sign in WIRING["commands"].items():
            naive["commands"][joint]["sign"] = sign
        for name, zero in OFFSETS.items():
            naive["pressures"][name]["zero"] = zero
        self.truth = folder / "truth.yaml"
        self.truth.write_text(yaml.safe_dump(naive))
        plant = folder / "plant.yaml"
        base = str(machine_file("simulated_crane.yaml"))
        plant.write_text(yaml.safe_dump({"base": base, "valves": VALVES}))
        self.plant = plant
        self.port = f"port={free_port()}"
        layout = load_layout(load_machine(), self.truth, machine_file("can.dbc"))
        self._machine_side, self._driver_side = MachineCodec(layout), DriverCodec(layout)
        self.link = Link(BusSettings(extra={"port": int(self.port[5:])})).open()
        self.machine = start(
            *(MACHINE, "--bus-option", self.port, "--mapping", str(self.truth)),
            *("--plant", str(plant), "--operator", "--lock-step"),
        )
        self.driver: subprocess.Popen[str] | None = None
        self.true: dict[str, float] = {}
        self.seen = 0.0  # s, simulated time of the newest cycle
        self.trail: list[float] = []  # of the inner boom
        self.valves: tuple[dict[str, float], bool] = ({}, False)

    def start_driver(self, *arguments: str, program: str = DRIVER) -> None:
        if self.driver:
            assert end(self.driver) == 0
            self.look()  # at what the old one has sent
        self.driver, self.valves = start(program, *arguments), ({}, False)

    def restart_driver(self, tool: "Tool") -> None:
        """By the command line that a step has printed."""
        told = [one for one in tool.output.splitlines() if "crane_driver driver " in one]
        self.start_driver(*shlex.split(told[-1])[4:])

    def close(self) -> None:
        for process in (self.driver, self.machine):
            if process:
                end(process)
        self.link.close()

    def hands(self, text: str) -> None:
        assert self.machine.stdin
        self.machine.stdin.write(text + "\n")
        self.machine.stdin.flush()

    def look(self) -> None:
        time.sleep(0.005)
        for frame in self.link.take():
            if (told := told_time(frame, TIME)) is not None:
                self.seen = told / NANOSECONDS
            elif readings := self._driver_side.decode(frame):
                self.true |= readings.positions
                self.trail.append(readings.positions.get("inner_boom", math.nan))
            elif readings := self._machine_side.decode(frame):
                self.valves = readings.commands, bool(readings.enabled)

    def until(self, condition: Callable[[], object]) -> None:
        deadline = time.monotonic() + PATIENCE
        while not condition():
            assert time.monotonic() < deadline, "waited in vain"
            self.look()

    def still(self, joint: str) -> float:
        """Where a joint stands, once it does."""
        since, there = self.seen, self.true[joint]
        while self.seen < since + 0.3:
            self.look()
            if abs(self.true[joint] - there) > 2e-4:
                since, there = self.seen, self.true[joint]
        return there

    def pull(self, joint: str, way: float) -> float:
        """Move a joint up by its lever; where it stands then."""
        goal = self.true[joint] + way
        self.hands(f"{joint}=0.25")
        self.until(lambda: self.true[joint] > goal)
        self.hands(f"{joint}=0")
        return self.still(joint)


class Tool:
    """`bringup` as a process that is talked to."""

    def __init__(self, shop: Workshop, step: str, *options: str):
        arguments = [step, "--out", str(shop.folder / "bringup"), *options]
        arguments += ["--ros-args", *SIMULATED_TIME]
        self.shop, self.output, self._read = shop, "", 0
        self.process = subprocess.Popen(
            line(BRINGUP, *arguments),
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            env=environment(),
        )

    def expect(self, text: str) -> None:
        def said() -> bool:
            self._take()
            return text in self.output[self._read :]

        self.shop.until(lambda: said() or self.process.poll() is not None)
        assert said(), self.output
        self._read = self.output.index(text, self._read) + len(text)

    def answer(self, text: object) -> None:
        self.expect(" > ")
        self.say(f"{text}\n")

    def agree(self) -> int:
        """Yes to whatever it asks, until its end; its exit status."""

        def asked() -> bool:
            self._take()
            return " > " in self.output[self._read :]

        while True:
            self.shop.until(lambda: asked() or self.process.poll() is not None)
            if not asked():
                return self.done()
            self.answer("yes")

    def done(self) -> int:
        self.shop.until(lambda: self._take() or self.process.poll() is not None)
        self._take()
        return self.process.returncode

    def say(self, text: str) -> None:
        assert self.process.stdin
        self.process.stdin.write(text.encode())
        self.process.stdin.flush()

    def _take(self) -> None:
        assert self.process.stdout
        while select.select([self.process.stdout], [], [], 0.0)[0]:
            part = os.read(self.process.stdout.fileno(), 4096)
            if not part:
                return
            self.output += part.decode()
            print(part.decode(), end="")  # shown where a test fails, be it by waiting in vain
