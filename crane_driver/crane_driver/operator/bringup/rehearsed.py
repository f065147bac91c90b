"""Check that the files of a machine were rehearsed before bring-up moves a real crane."""

from pathlib import Path

from pydantic import ConfigDict

from crane_driver.operator.bringup.bench import BringupTerminal
from crane_model.errors import DataError
from crane_model.machine_files import machine_digest
from crane_model.result_file import ResultFile

REHEARSAL_FILE = "rehearsal.json"
NOT_CHECKED = (
    "wiring, signs and zeros of the real sensors and valves",
    "the emergency stop, hoses, fittings and valve electronics",
    "dead times, friction and loads of the real machine beyond the values in its files",
    "ground, obstacles and people",
)
"""Properties that a rehearsal on a simulated crane cannot check."""


class RehearsedFiles(ResultFile):
    """The part of rehearsal.json that bring-up reads."""

    model_config = ConfigDict(extra="ignore")

    date: str
    """When the rehearsal ended, UTC."""
    digest: str
    """SHA-256 of the files of the machine."""
    failed: dict[str, str]
    """Errors by step; empty if the rehearsal is complete."""


def why_not_rehearsed(folder: Path, machine: str) -> str:
    """Return why `folder` holds no rehearsal of a machine's files; empty if it does."""
    try:
        found = RehearsedFiles.read(folder / REHEARSAL_FILE)
    except DataError as error:
        return str(error)
    if found.failed:
        return f"the rehearsal of {found.date} is not complete: {', '.join(found.failed)} failed"
    if found.digest != machine_digest(machine):
        return f"files of the machine have changed since the rehearsal of {found.date}"
    return ""


def ask_for_rehearsal(terminal: BringupTerminal, folder: Path, machine: str) -> None:
    """Ask the operator whether to go on if these files were not rehearsed.

    `NotConfirmedError` unless the answer is yes.
    """
    why_not = why_not_rehearsed(folder, machine)
    known = "These files were rehearsed." if not why_not else f"Not rehearsed: {why_not}."
    terminal.say(f"{known} A rehearsal does not check")
    for subject in NOT_CHECKED:
        terminal.say(f"  - {subject}")
    if why_not:
        named = f" --machine {machine}" if machine else ""
        terminal.say(
            f"Rehearse first: ros2 run crane_benchmark rehearse{named} --out {folder} --replace"
        )
        terminal.confirm("Go on without a rehearsal?")
