"""Where the files of a machine are: all in one folder, beside its machine file."""

from pathlib import Path

import crane_machines
from crane_model.errors import ConfigurationError


def machine_file(name: str, machine: Path | str | None = None) -> Path:
    """Path of the file `name` of a `machine`: a shipped one's name, a folder or a machine file.

    None or "" is the laboratory crane. `ConfigurationError` if there is no such machine, or it has
    no such file.

    >>> machine_file("excitation_20s.yaml").parent.name
    'laboratory_crane'
    """
    try:
        folder = crane_machines.folder(machine or crane_machines.DEFAULT)
    except crane_machines.NoSuchMachineError as error:
        raise ConfigurationError(str(error)) from None
    if name == crane_machines.MACHINE_FILE and Path(machine or "").is_file():
        return Path(machine or "")  # whatever it is called
    path = folder / name
    if not path.is_file():
        there = ", ".join(sorted(one.name for one in folder.iterdir() if one.is_file()))
        raise ConfigurationError(
            f"{path}: no such file of the machine (it has {there}); write it there, or name "
            f"another one"
        )
    return path
