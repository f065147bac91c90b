"""Files of a machine with the patience that a busy test machine needs."""

from collections.abc import Mapping
from pathlib import Path

import yaml
from integration.processes import COMMAND_TIMEOUT, TIMING

from crane_model.machine_files import DEFAULT_MACHINE, machine_file


def patient_mapping(
    folder: Path, canopen: Mapping[str, object] = {}, machine: str = DEFAULT_MACHINE
) -> Path:
    """The machine's mapping with the patience that a busy test machine needs."""
    mapping = yaml.safe_load(machine_file("can.yaml", machine).read_text())
    path = folder / "mapping.yaml"
    path.write_text(yaml.safe_dump({**mapping, "timing": TIMING, "canopen": dict(canopen)}))
    return path


def patient_safety(folder: Path, machine: str = DEFAULT_MACHINE) -> str:
    """The machine's safety.yaml with a driver that waits longer for commands: a busy test machine
    is late by itself.
    """
    settings = yaml.safe_load(machine_file("safety.yaml", machine).read_text())
    path = folder / "safety.yaml"
    path.write_text(yaml.safe_dump(settings | {"command_timeout": COMMAND_TIMEOUT}))
    return str(path)
