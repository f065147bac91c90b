"""The stand-in for `ros2` lists and starts executables as the real command does."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

STAND_IN = Path(__file__).resolve().parents[3] / "scripts" / "ros2_stand_in" / "ros2"


def add_executable(prefix: Path, package: str, name: str, body: str) -> None:
    marker = prefix / "share" / "ament_index" / "resource_index" / "packages" / package
    program = prefix / "lib" / package / name
    for path in (marker, program):
        path.parent.mkdir(parents=True, exist_ok=True)
    marker.touch()
    program.write_text(f"#!/bin/sh\n{body}\n")
    program.chmod(0o755)


@pytest.fixture
def prefixes(tmp_path: Path) -> str:
    """Two installed trees, as a workspace over a ROS installation."""
    over, under = tmp_path / "over", tmp_path / "under"
    add_executable(over, "crane_thing", "greet", 'echo "hello $*"; exit 7')
    add_executable(over, "crane_thing", "wait", "echo up; exec sleep 60")
    add_executable(under, "crane_thing", "hidden", "exit 0")
    add_executable(under, "other_thing", "greet", "exit 0")
    (over / "lib" / "crane_thing" / "notes.txt").write_text("not an executable")
    return f"{over}:{under}:{tmp_path / 'absent'}"


def ros2(prefixes: str, *arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, STAND_IN, *arguments],
        env=os.environ | {"AMENT_PREFIX_PATH": prefixes},
        capture_output=True,
        text=True,
    )


def test_runs_with_arguments_and_exit_status(prefixes: str) -> None:
    done = ros2(prefixes, "run", "crane_thing", "greet", "--ros-args", "-p", "a:=1", "--help")
    assert done.stdout == "hello --ros-args -p a:=1 --help\n"
    assert done.returncode == 7


def test_signals_reach_the_executable(prefixes: str) -> None:
    process = subprocess.Popen(
        [sys.executable, STAND_IN, "run", "crane_thing", "wait"],
        env=os.environ | {"AMENT_PREFIX_PATH": prefixes},
        stdout=subprocess.PIPE,
        text=True,
    )
    assert process.stdout is not None
    assert process.stdout.readline() == "up\n"
    process.terminate()
    assert process.wait(timeout=30) == -signal.SIGTERM
    process.stdout.close()


def test_lists_executables(prefixes: str) -> None:
    listing = "crane_thing greet\ncrane_thing wait\n"
    assert ros2(prefixes, "pkg", "executables", "crane_thing").stdout == listing
    assert ros2(prefixes, "pkg", "executables").stdout == listing + "other_thing greet\n"


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["run", "no_thing", "greet"], "Package 'no_thing' not found"),
        (["run", "crane_thing", "gret"], "No executable 'gret' in crane_thing; it has: greet"),
        (["pkg", "executables", "no_thing"], "Package 'no_thing' not found"),
        (["topic", "list"], "not understood: ros2 topic list"),
        (["run", "crane_thing"], "not understood: ros2 run crane_thing"),
    ],
)
def test_errors(prefixes: str, arguments: list[str], message: str) -> None:
    done = ros2(prefixes, *arguments)
    assert done.returncode == 1
    assert message in done.stderr
    assert done.stdout == ""


@pytest.mark.parametrize("arguments", [[], ["--help"], ["run", "--help"], ["pkg", "-h"]])
def test_help_says_what_it_is(prefixes: str, arguments: list[str]) -> None:
    done = ros2(prefixes, *arguments)
    assert done.returncode == 0
    assert done.stdout.startswith("Stand-in for the `ros2` command")
