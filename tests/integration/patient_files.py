"""Files of a machine for a driver in real time, with the patience that a busy computer needs."""

from collections.abc import Mapping
from pathlib import Path

import yaml
from integration.processes import COMMAND_TIMEOUT, TIMING

from crane_model.machine_files import DEFAULT_MACHINE, machine_file


def mapping_file(
    folder: Path,
    machine: str = DEFAULT_MACHINE,
    canopen: Mapping[str, object] = {},
    patient: bool = True,
) -> Path:
    """The machine's mapping with CANopen devices and, if it is patient, later frames."""
    mapping = yaml.safe_load(machine_file("can.yaml", machine).read_text())
    mapping |= {"canopen": dict(canopen)} | ({"timing": TIMING} if patient else {})
    path = folder / "mapping.yaml"
    path.write_text(yaml.safe_dump(mapping))
    return path


def patient_safety(folder: Path, machine: str = DEFAULT_MACHINE) -> str:
    """The machine's safety.yaml with a driver that waits longer for commands."""
    settings = yaml.safe_load(machine_file("safety.yaml", machine).read_text())
    path = folder / "safety.yaml"
    path.write_text(yaml.safe_dump(settings | {"command_timeout": COMMAND_TIMEOUT}))
    return str(path)
