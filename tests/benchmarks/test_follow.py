"""The page "from a bag to a crane that follows", walked on the simulated crane."""

import os
import re
import signal
import subprocess
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from benchmarks.live_loop import reset
from integration.processes import PATIENCE
from laboratory_crane import PLANAR_JOINTS
from manual import ROOT, text

from crane_trajectory.run_excitation_node import ExcitationResult

BLOCK = re.compile(r"```bash\n(.*?)```", re.DOTALL)
READY = {"simulated_crane": "ready:", "driver": "-> disabled", "trajectory": "ready:",
         "recorder": "recording /cylinder_pressures"}  # fmt: skip
TARGET, BETTER = 1e-3, 10.0  # rad or m; times
TRIES = 8  # of an experiment, on a computer that is busy


class Shells:
    """A folder like the clone, and what runs in it."""

    def __init__(self, folder: Path, domain: int):
        self.folder, self._domain = folder, domain
        self.running: dict[str, subprocess.Popen[bytes]] = {}
        (folder / "src").symlink_to(ROOT / "src")

    def log(self, name: str) -> str:
        return (self.folder / f"{name}.log").read_text("utf-8", "replace")

    def background(self, command: str) -> None:
        name = command.split()[3]
        with (self.folder / f"{name}.log").open("wb") as log:
            self.running[name] = subprocess.Popen(
                ["bash", "-c", f"exec {command}"], cwd=self.folder, stdout=log,
                stderr=subprocess.STDOUT, start_new_session=True,
            )  # fmt: skip
        deadline = time.monotonic() + PATIENCE
        while READY[name] not in self.log(name):
            assert time.monotonic() < deadline, self.log(name)
            assert self.running[name].poll() is None, self.log(name)
            time.sleep(0.1)

    def foreground(self, command: str) -> str:
        done = subprocess.run(
            ["bash", "-c", command], cwd=self.folder, capture_output=True, text=True
        )
        assert done.returncode == 0, done.stdout + done.stderr
        return done.stdout

    def experiment(self, command: str) -> None:
        """Faults that a busy computer makes are reset, and what they ended is repeated."""
        for number in range(TRIES):
            reset(self._domain, self.folder)
            try:
                self.foreground(command if number == 0 else f"{command} --replace")
                return
            except AssertionError as error:
                ended = error
        raise ended

    def end(self, name: str) -> None:
        process = self.running.pop(name)
        os.killpg(process.pid, signal.SIGINT)
        assert process.wait(PATIENCE) == 0, self.log(name)


@pytest.fixture
def shells(ros_domain: int, tmp_path: Path) -> Iterator[Shells]:
    started = Shells(tmp_path, ros_domain)
    yield started
    for process in reversed(started.running.values()):
        os.killpg(process.pid, signal.SIGKILL)


def commands() -> list[str]:
    """Of the page, one after the other, up to the crane that follows."""
    steps = text("docs/how_to/follow.md").partition("## Move the tip")[0]
    page = "\n".join(BLOCK.findall(steps)).replace("\\\n", " ")
    lines = (line.partition("#")[0].strip() for line in page.splitlines())
    return [line for line in lines if line]


def test_a_stranger_walks_from_a_bag_to_a_crane_that_follows(
    shells: Shells, measured: Callable[..., None]
) -> None:
    for command in commands():
        if command.split()[3] in READY:
            shells.background(command)
            continue
        if " run_excitation " in command:
            shells.experiment(command)
            continue
        if " identify " in command:  # as the page says: recorder and trajectory node end before
            shells.end("recorder")
            shells.end("trajectory")
        told = shells.foreground(command)
        if " tune " in command:
            assert "margins suffice" in told
    for name in tuple(shells.running):
        shells.end(name)
    before, after = (
        ExcitationResult.read(shells.folder / f"runs/{name}.json").rms_tracking_error
        for name in ("before", "after")
    )
    for joint in PLANAR_JOINTS:
        was, now = before[joint], after[joint]
        assert was and now
        measured(
            f"live, by the steps of the guide, {joint}: RMS, PD controller, identified model",
            f"{1e3 * TARGET:g} mrad or mm, {BETTER:g} times better",
            "{was:.1f}, {now:.2f}; {times:.0f} times",
            was=1e3 * was, now=1e3 * now, times=was / now,
        )  # fmt: skip
        assert now <= TARGET
        assert was >= BETTER * now
