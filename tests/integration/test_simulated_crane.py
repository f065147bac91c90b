"""The simulated crane as a process on its bus, commanded and led through time by a test."""

import re
import signal
import subprocess
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import pytest
from integration.driver_stage import FRAMES
from integration.processes import MACHINE, PATIENCE, end, free_port, start
from known_crane import write_known_model

from crane_driver import BusSettings, DriverCodec, Link, load_layout
from crane_driver.can.codec import Readings
from crane_driver.can.frame import TIME, step_frame, told_time
from crane_model import load_machine
from crane_model.machine_files import machine_file
from crane_sim.simulated_crane import main

CYCLE = 0.005  # s
POLL = 0.1  # s


class Bench:
    def __init__(self, *options: object) -> None:
        port = free_port()
        self.codec = DriverCodec(
            load_layout(load_machine(), machine_file("can.yaml"), machine_file("can.dbc"))
        )
        self._woken = threading.Event()
        settings = BusSettings(extra={"port": port})
        self.link = Link(settings, self._woken.set, FRAMES, frozenset({TIME})).open()
        self.process = start(MACHINE, "--bus-option", f"port={port}", *map(str, options))
        self.readings: list[Readings] = []
        self.state = ""

    def until(self, condition: Callable[[], object], **commands: float) -> None:
        """Let time go on until a condition holds; send commands meanwhile, if there are any."""
        deadline = time.monotonic() + PATIENCE
        while not condition():
            assert time.monotonic() < deadline, "waited in vain"
            self._woken.wait(POLL)
            self._woken.clear()
            for frame in self.link.take():
                if (told := told_time(frame, TIME)) is not None:
                    self._answer(told, commands)
                    continue
                readings = self.codec.decode(frame)
                assert readings
                self.readings.append(readings)
                self.state = readings.states.get("valve_unit", self.state)

    def _answer(self, told: int, commands: dict[str, float]) -> None:
        """Valves that have timed out are told neutral before they open."""
        if commands:
            timed_out = self.state == "CommandTimeout"
            for frame in self.codec.command_frames(commands, enabled=not timed_out):
                self.link.send(frame)
        self.link.send(step_frame(told))

    def position(self, joint: str) -> float:
        return next(one.positions[joint] for one in self.readings[::-1] if joint in one.positions)


@contextmanager
def at_work(*options: object, pace: Sequence[str] = ("--lock-step",)) -> Iterator[Bench]:
    one = Bench(*options, *pace)
    try:
        yield one
    finally:
        end(one.process)
        one.link.close()


def test_it_moves_on_command_and_stops_when_commands_do() -> None:
    with at_work() as bench:
        bench.until(lambda: bench.state == "Neutral")
        before = bench.position("telescope")
        bench.until(lambda: bench.position("telescope") > before + 0.02, telescope=0.5)
        bench.until(lambda: bench.state == "Enabled", telescope=0.5)
        bench.until(lambda: bench.state == "CommandTimeout")
        stopped = len(bench.readings)
        bench.until(lambda: len(bench.readings) > stopped + 1000)
        there = bench.position("telescope")
        bench.until(lambda: len(bench.readings) > stopped + 2000)
        assert bench.position("telescope") == pytest.approx(there, abs=2e-4)


def sent_and_due(bench: Bench) -> tuple[int, float]:
    """Cycles that the machine has sent in a window of time, and that the window has."""
    bench.readings.clear()
    bench.until(lambda: len(bench.readings) > 2000)
    cycles = [one for one in bench.readings if one.message == "EncoderBase"]
    return len(cycles), (cycles[-1].steady - cycles[0].steady) / CYCLE


@pytest.mark.realtime
def test_it_runs_in_real_time_and_says_how_well() -> None:
    with at_work(pace=()) as bench:
        windows = [sent_and_due(bench) for _ in range(3)]
        bench.process.send_signal(signal.SIGTERM)
        output, _ = bench.process.communicate(timeout=PATIENCE)
    assert bench.process.returncode == 0
    summary = re.search(r"(\d+) cycles, (\d+) of (\d+) left out, longest delay \d+ ms", output)
    assert summary
    run, left_out, total = map(int, summary.groups())
    assert run + left_out == total
    # Never faster than the clock, and what is missing is owned up to. A busy test machine may stamp
    # or lose the first and the last frames of a window a second late, but hardly of each.
    assert any(due - left_out - 10 <= sent <= due + 10 for sent, due in windows), windows


def test_an_identified_model_moves_in_its_place(tmp_path: Path) -> None:
    with at_work("--model", write_known_model(tmp_path / "model.yaml")) as bench:
        bench.until(lambda: bench.state == "Neutral")
        before = bench.position("telescope")
        bench.until(lambda: bench.position("telescope") > before + 0.02, telescope=0.5)
        bench.process.send_signal(signal.SIGTERM)
        output, _ = bench.process.communicate(timeout=PATIENCE)
    assert "model.yaml; its model lacks slew, which will not move" in output


def test_a_plug_is_pulled_in_mid_motion_and_put_back() -> None:
    with at_work("--operator") as bench:
        assert bench.process.stdin
        bench.until(lambda: bench.state == "Neutral")
        before = bench.position("telescope")
        bench.until(lambda: bench.position("telescope") > before + 0.02, telescope=0.5)
        bench.process.stdin.write("fault=telescope.encoder.stuck\n")
        bench.process.stdin.flush()
        bench.until(
            lambda: len({one.positions["telescope"] for one in bench.readings[-200:]
                         if "telescope" in one.positions}) == 1,
            telescope=0.5,
        )  # fmt: skip
        frozen = bench.position("telescope")
        bench.process.stdin.write("repaired=telescope.encoder\n")
        bench.process.stdin.flush()
        bench.until(lambda: bench.position("telescope") > frozen + 0.02, telescope=0.5)
        bench.process.send_signal(signal.SIGTERM)
        output, _ = bench.process.communicate(timeout=PATIENCE)
    assert "fault: telescope.encoder.stuck" in output
    assert "repaired: telescope.encoder" in output


def test_a_bus_that_cannot_be_opened_ends_it_with_a_message() -> None:
    assert main(["--interface", "socketcan", "--channel", "nocan0"]) == 1


def test_it_ends_by_itself_when_its_terminal_does() -> None:
    with at_work() as bench:
        bench.until(lambda: bench.readings)
        bench.process.send_signal(signal.SIGHUP)
        try:
            assert bench.process.wait(PATIENCE) == 0
        except subprocess.TimeoutExpired:
            pytest.fail("still running")
