"""Bring-up on a real bus asks for a rehearsal of the same files."""

import json
import shutil
from pathlib import Path

import pytest

from crane_driver import BusSettings
from crane_driver.can.bus import may_leave_computer
from crane_driver.operator.bringup.bench import NotConfirmedError
from crane_driver.operator.bringup.rehearsed import (
    NOT_CHECKED,
    ask_for_rehearsal,
    why_not_rehearsed,
)
from crane_model.machine_files import machine_digest, machine_file


class Terminal:
    """Answers each question with the same word."""

    def __init__(self, answer: str):
        self.answer, self.said, self.asked = answer, "", 0

    def say(self, text: str) -> None:
        self.said += text + "\n"

    def confirm(self, question: str) -> None:
        self.asked += 1
        if self.answer != "yes":
            raise NotConfirmedError(question)


@pytest.fixture
def mine(tmp_path: Path) -> Path:
    folder = tmp_path / "mine"
    shutil.copytree(machine_file("machine.yaml", "single_axis").parent, folder)
    return folder


@pytest.fixture
def rehearsal(tmp_path: Path, mine: Path) -> Path:
    """A folder with the result of a complete rehearsal."""
    write(tmp_path, machine_digest(mine))
    return tmp_path


def write(folder: Path, digest: str, **failed: str) -> None:
    content = {"date": "2026-11-28", "digest": digest, "failed": failed, "seed": 1}
    (folder / "rehearsal.json").write_text(json.dumps(content))


def test_the_same_files_are_not_asked_for_again(rehearsal: Path, mine: Path) -> None:
    terminal = Terminal("no")
    ask_for_rehearsal(terminal, rehearsal, str(mine))  # type: ignore[arg-type]
    assert terminal.asked == 0
    assert "These files were rehearsed" in terminal.said
    assert all(subject in terminal.said for subject in NOT_CHECKED)


def test_a_changed_file_needs_another_rehearsal(rehearsal: Path, mine: Path) -> None:
    with (mine / "safety.yaml").open("a") as file:
        file.write("# another deceleration\n")
    assert "files of the machine have changed" in why_not_rehearsed(rehearsal, str(mine))


def test_pictures_in_the_folder_do_not_count(rehearsal: Path, mine: Path) -> None:
    (mine / "notes.png").write_bytes(b"a photograph")
    assert why_not_rehearsed(rehearsal, str(mine)) == ""


def test_an_incomplete_rehearsal_does_not_count(tmp_path: Path, mine: Path) -> None:
    write(tmp_path, machine_digest(mine), control="it swings")
    assert "not complete: control failed" in why_not_rehearsed(tmp_path, str(mine))


@pytest.mark.parametrize("answer", ["yes", "no"])
def test_the_operator_may_go_on_without(tmp_path: Path, mine: Path, answer: str) -> None:
    terminal = Terminal(answer)
    if answer == "yes":
        ask_for_rehearsal(terminal, tmp_path / "nothing", str(mine))  # type: ignore[arg-type]
    else:
        with pytest.raises(NotConfirmedError, match="without a rehearsal"):
            ask_for_rehearsal(terminal, tmp_path / "nothing", str(mine))  # type: ignore[arg-type]
    assert terminal.asked == 1
    assert f"crane_benchmark rehearse --machine {mine}" in terminal.said


def test_which_buses_leave_the_computer() -> None:
    assert may_leave_computer(BusSettings(interface="socketcan", channel="can0"))
    assert may_leave_computer(BusSettings(interface="udp_multicast", extra={"hop_limit": 1}))
    assert not may_leave_computer(BusSettings(interface="udp_multicast"))
    assert not may_leave_computer(BusSettings(interface="virtual"))
