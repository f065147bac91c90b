"""Ctrl-C ends the demo at any moment: no process is left, and what was recorded can be read."""

import os
import signal
import subprocess
import sys
import uuid
from collections.abc import Iterator
from pathlib import Path

import pytest
from left_behind import alive_with

from crane_bags import read_topics
from crane_bags.types import JOINT_STATES, VALVE_COMMAND

DEMO = Path(__file__).parents[2] / "scripts" / "demo" / "demo.py"
MARK = "CRANE_DEMO_UNDER_TEST"


@pytest.fixture
def mark() -> bytes:
    """What all processes of one demo inherit in their environment."""
    return f"{MARK}={uuid.uuid4().hex}".encode()


@pytest.fixture
def demo(tmp_path: Path, mark: bytes) -> Iterator[subprocess.Popen[bytes]]:
    """The demo in a folder of its own."""
    process = subprocess.Popen(
        [sys.executable, str(DEMO)],
        cwd=tmp_path,
        env=os.environ | {MARK: mark.decode().partition("=")[2]},
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        bufsize=0,
    )
    yield process
    process.kill()
    process.wait()
    for number, _ in alive_with(mark):  # of a demo that did not end them itself
        os.kill(number, signal.SIGKILL)


def wait_for(process: subprocess.Popen[bytes], text: bytes) -> None:
    """Until the demo has printed this."""
    assert process.stdout
    seen = b""
    while text not in seen:
        read = process.stdout.read(4096)
        assert read, f"ended without '{text.decode()}': {seen.decode()}"
        seen += read


def interrupt(process: subprocess.Popen[bytes]) -> tuple[int, str]:
    """Ctrl-C twice, as an impatient person does; exit status and what was printed then."""
    assert process.stdout
    process.send_signal(signal.SIGINT)
    process.send_signal(signal.SIGINT)
    rest = process.stdout.read().decode()
    return process.wait(), rest


def test_while_it_starts(demo: subprocess.Popen[bytes], mark: bytes) -> None:
    wait_for(demo, b"starting")
    status, printed = interrupt(demo)
    assert status == 130
    assert "interrupted" in printed
    assert alive_with(mark) == []


def test_while_the_crane_moves(demo: subprocess.Popen[bytes], mark: bytes, tmp_path: Path) -> None:
    wait_for(demo, b" of 73 s")
    assert len(alive_with(mark)) == 7  # the demo, five nodes, the client of the action
    status, printed = interrupt(demo)
    assert status == 130
    assert "CANCELED" in printed, "the crane is brought to rest first"
    assert alive_with(mark) == []
    topics = read_topics(tmp_path / "runs/demo/bags/train", [JOINT_STATES], [VALVE_COMMAND])
    assert len(topics[JOINT_STATES.name].stamp) > 200
    commands = topics[VALVE_COMMAND.name].fields["command"]
    assert (abs(commands[-1]) <= 0.05).all(), "the last command is neutral"
