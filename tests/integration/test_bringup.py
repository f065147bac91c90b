"""A crane that is wired otherwise than the driver believes, brought up step by step."""

import math
import os
import select
import signal
import subprocess
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from integration.driver_stage import (
    DRIVER,
    MACHINE,
    PATIENCE,
    RUN,
    TIMING,
    end,
    environment,
    free_port,
    line,
    start,
)

from crane_driver.bringup.series import Directions, Result
from crane_driver.can.binding import load_layout
from crane_driver.can.bus import BusSettings
from crane_driver.can.codec import DriverCodec, MachineCodec
from crane_driver.can.link import Link
from crane_driver.can.mapping import Mapping
from crane_driver.velocity_filter import VelocityFilter
from crane_model.configuration import load, packaged
from crane_model.machine import JOINTS, load_machine
from crane_sim.parameters import load_stand_in
from crane_sim.plant import Plant
from crane_trajectory.controller import command, load_gains

pytestmark = pytest.mark.realtime

BRINGUP = RUN.format(module="crane_driver.bringup.main")
MEASURED = ("inner_boom", "outer_boom")
WIRING = {  # (sign, zero) of encoders, sign of valves
    "positions": {"inner_boom": (-1, 0.3), "outer_boom": (1, -0.2)},
    "commands": {"inner_boom": 1, "outer_boom": -1},
}
OFFSETS = {"inner_boom.a": 2.5e5, "outer_boom.b": 1.2e5, "tank": 0.8e5}  # Pa
VALVES = {  # dead bands +0.085 and -0.055; +0.06 and -0.10
    "inner_boom": {"dead_zone": 0.07, "null_bias": 0.015},
    "outer_boom": {"dead_zone": 0.08, "null_bias": -0.02},
}
FAST = ["--joints", *MEASURED, "--seconds", "0.5", "--rate", "0.1", "--repeats", "1"]


class Workshop:
    """The crane, a driver that can be given another mapping, and the operator's eyes and hands."""

    def __init__(self, folder: Path):
        self.folder = folder
        naive = yaml.safe_load(packaged("crane_driver", "laboratory_crane_can.yaml").read_text())
        naive["timing"] = TIMING
        self.naive = folder / "naive.yaml"
        self.naive.write_text(yaml.safe_dump(naive))
        for joint, (sign, zero) in WIRING["positions"].items():
            naive["positions"][joint] |= {"sign": sign, "zero": zero}
        for joint, sign in WIRING["commands"].items():
            naive["commands"][joint]["sign"] = sign
        for name, zero in OFFSETS.items():
            naive["pressures"][name]["zero"] = zero
        truth = folder / "truth.yaml"
        truth.write_text(yaml.safe_dump(naive))
        plant = folder / "plant.yaml"
        base = str(packaged("crane_sim", "stand_in.yaml"))
        plant.write_text(yaml.safe_dump({"base": base, "valves": VALVES}))
        self.plant = plant
        self.port = f"port={free_port()}"
        layout = load_layout(truth)
        self._machine_side, self._driver_side = MachineCodec(layout), DriverCodec(layout)
        self.link = Link(BusSettings(extra={"port": int(self.port[5:])})).open()
        self.machine = start(
            MACHINE, "--bus-option", self.port, "--mapping", str(truth), "--plant", str(plant),
            "--operator",
        )  # fmt: skip
        self.driver: subprocess.Popen[str] | None = None
        self.true: dict[str, float] = {}
        self.trail: list[float] = []  # of the inner boom
        self.valves: tuple[dict[str, float], bool] = ({}, False)

    def start_driver(self, mapping: Path) -> None:
        if self.driver:
            assert end(self.driver) == 0
        options = ["-p", f"bus.options:={self.port}", "-p", f"mapping:={mapping}"]
        self.driver = start(DRIVER, "--ros-args", *options)

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
            if readings := self._driver_side.decode(frame):
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
        since, there = time.monotonic(), self.true[joint]
        while time.monotonic() < since + 0.3:
            self.look()
            if abs(self.true[joint] - there) > 2e-4:
                since, there = time.monotonic(), self.true[joint]
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

    def done(self) -> int:
        self.shop.until(lambda: self._take() or self.process.poll() is not None)
        self._take()
        print(self.output)
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


@pytest.fixture(scope="module")
def shop(ros_domain: int, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Workshop]:
    one = Workshop(tmp_path_factory.mktemp("bringup"))
    one.start_driver(one.naive)
    one.until(lambda: one.true.keys() >= set(JOINTS))
    yield one
    one.close()


def moves(shop: Workshop, step: str, *options: str) -> dict[str, float]:
    """Run a step that moves the crane, again where the test machine was too busy for it; where
    the joints stood before.
    """
    for _ in range(3):
        before = {joint: shop.still(joint) for joint in MEASURED}
        tool = Tool(shop, step, *FAST, *options)
        tool.say("yes\n" * len(MEASURED))  # all answers at once, as from a file
        if tool.done() == 0:
            return before
        busy = "too busy", "no /joint_states", "refuses commands"
        assert any(text in tool.output for text in busy), tool.output
    pytest.fail(f"{step} never ran to its end")


def runs(shop: Workshop, step: str) -> list[Path]:
    """Folders of a step, oldest first: each try makes one."""
    return sorted((shop.folder / "bringup").glob(f"*_{step}"))


def result(shop: Workshop, step: str) -> dict[str, Any]:
    folder = runs(shop, step)[-1]
    assert (folder / f"{step}.png").stat().st_size > 5000
    return yaml.safe_load((folder / "result.yaml").read_text())["results"]


def test_encoders(shop: Workshop) -> None:
    tool = Tool(shop, "encoders", *FAST)
    for joint in MEASURED:
        tool.expect(f"{joint}: let it stand still")
        tool.answer(f"{math.degrees(shop.still(joint)):.3f}")
        tool.expect("now move it")
        tool.answer(f"{math.degrees(shop.pull(joint, 0.12)):.3f}")
    assert tool.done() == 0
    for joint, one in result(shop, "encoders").items():
        sign, zero = WIRING["positions"][joint]
        assert one["sign"] == sign
        assert one["zero"] == pytest.approx(zero, abs=2e-4)
        assert one["scale"] == pytest.approx(1.0, abs=0.01)


def test_a_driver_with_another_mapping_is_refused(shop: Workshop) -> None:
    tool = Tool(shop, "pressures")
    assert tool.done() == 1
    assert "the driver runs with the mapping" in tool.output
    shop.start_driver(runs(shop, "encoders")[-1] / "mapping.yaml")


def test_pressures(shop: Workshop) -> None:
    tool = Tool(shop, "pressures", *FAST)
    tool.expect("Engine stopped")
    tool.answer("yes")  # though it runs
    assert tool.done() == 1
    assert "not vented" in tool.output
    shop.hands("engine=off")
    tool = Tool(shop, "pressures", *FAST)
    tool.answer("yes")
    assert tool.done() == 0
    for name, one in result(shop, "pressures").items():
        # a transducer ends at 0 bar: half of the noise of one without offset is cut off
        assert one["offset"] == pytest.approx(OFFSETS.get(name, 0.0), abs=1e4)
    shop.hands("engine=on")
    shop.start_driver(runs(shop, "pressures")[-1] / "mapping.yaml")


def test_what_is_not_confirmed_moves_nothing(shop: Workshop) -> None:
    tool = Tool(shop, "valves", *FAST)
    tool.answer("y")
    assert tool.done() == 1
    assert "not confirmed" in tool.output
    assert not shop.valves[1]


def test_valves(shop: Workshop) -> None:
    before = moves(shop, "valves")
    for joint, one in result(shop, "valves").items():
        assert one["polarity"] == WIRING["commands"][joint]
        assert shop.still(joint) == pytest.approx(before[joint], abs=0.02)
    shop.start_driver(runs(shop, "valves")[-1] / "mapping.yaml")


def test_the_last_mapping_is_the_wiring_of_the_machine(shop: Workshop) -> None:
    found = load(runs(shop, "valves")[-1] / "mapping.yaml", Mapping)
    true = load(shop.folder / "truth.yaml", Mapping)
    for joint in JOINTS:
        assert found.commands[joint].sign == true.commands[joint].sign
        assert found.positions[joint].sign == true.positions[joint].sign
        assert found.positions[joint].zero == pytest.approx(true.positions[joint].zero, abs=2e-4)
    for name, one in true.pressures.items():
        assert found.pressures[name].zero == pytest.approx(one.zero, abs=1e4)


def test_dead_band(shop: Workshop) -> None:
    before = moves(shop, "dead_band")
    run = runs(shop, "dead_band")[-1]
    for joint, one in load(run / "result.yaml", Result[Directions]).results.items():
        valve = VALVES[joint]
        for direction, measured in ((1, one.positive), (-1, one.negative)):
            true = valve["dead_zone"] + direction * valve["null_bias"]
            assert measured.dead_band == pytest.approx(true, abs=0.003)
        assert shop.still(joint) == pytest.approx(before[joint], abs=0.01)


def test_ctrl_c_while_it_moves_is_neutral_disabled_and_the_end(shop: Workshop) -> None:
    before = runs(shop, "dead_band")
    tool = Tool(shop, "dead_band", *FAST)
    tool.answer("yes")
    shop.until(lambda: shop.valves[1] and abs(shop.valves[0]["inner_boom"]) > 0.09)
    tool.process.send_signal(signal.SIGINT)
    shop.until(lambda: not shop.valves[1] and not any(shop.valves[0].values()))
    assert tool.done() == 130
    assert runs(shop, "dead_band") == before


def test_gains(shop: Workshop) -> None:
    controller = packaged("crane_trajectory", "controller.yaml")
    moves(shop, "gains", "--controller", str(controller))
    path = runs(shop, "gains")[-1] / "controller.yaml"
    measured, base = load_gains(path), load_gains(controller)
    assert measured.slew == base.slew
    assert measured.inner_boom != base.inner_boom
    errors, end_speed = tracked(shop.plant, path)
    assert np.abs(errors).max() < 0.02
    assert np.abs(end_speed).max() < 1e-3


def test_status_tells_what_has_been_done(shop: Workshop) -> None:
    tool = Tool(shop, "status")
    assert tool.done() == 0
    assert "done: encoders, pressures, valves, dead_band, gains; to be done: nothing" in tool.output
    assert "_valves/mapping.yaml" in tool.output


def tracked(plant_file: Path, controller: Path) -> tuple[np.ndarray, np.ndarray]:
    """Errors (n, 2) of a sine of 0.1 rad and 0.03 Hz, and speeds (m, 2) after it, by new gains."""
    parameters, machine = load_stand_in(plant_file), load_machine()
    plant = Plant(parameters, machine, parameters.start)
    table = load_gains(controller).table
    chain, density = parameters.sensors, parameters.jerk_density
    speed_filter = VelocityFilter(
        [density[joint] for joint in JOINTS], [chain.encoder_resolution[joint] for joint in JOINTS]
    )
    columns = [JOINTS.index(joint) for joint in MEASURED]
    period, frequency, u = 0.005, 2.0 * np.pi * 0.03, np.zeros(4)
    errors, speeds = [], []
    moving = 2.0 * np.pi / frequency
    for time_ in np.arange(0.0, moving + 4.0, period):
        phase = frequency * min(time_, moving)
        reference, reference_speed = parameters.start.copy(), np.zeros(4)
        reference[columns] += 0.05 * (1.0 - np.cos(phase))
        reference_speed[columns] = 0.05 * frequency * np.sin(phase)
        plant.advance(u, period)
        position = chain.measure_positions(plant.q)
        _, speed, _ = speed_filter.update(time_, position)
        if np.isfinite(speed).all():
            u = command(table, position, speed, reference, reference_speed)
        errors.append((plant.q - reference)[columns])
        if time_ > moving + 3.0:
            speeds.append(plant.v[columns])
    return np.array(errors), np.array(speeds)
