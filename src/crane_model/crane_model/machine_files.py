"""Where the files of a machine are: all in one folder, beside its machine file."""

from pathlib import Path

import crane_machines
from crane_model.errors import ConfigurationError

DEFAULT_MACHINE = crane_machines.DEFAULT


def machine_file(
    name: str, machine: Path | str | None = None, given: Path | str | None = None
) -> Path:
    """Path of the file `name` of a `machine`: a shipped one's name, a folder or a machine file.

    None or "" is the laboratory crane. Where another file is `given`, it is that one: a path, or
    a bare name of a file in the machine's folder, with or without `.yaml`. `ConfigurationError` if
    there is no such machine, or it has no such file.

    >>> machine_file("excitation_20s.yaml").parent.name
    'laboratory_crane'
    """
    if given and (Path(given).exists() or Path(given).name != str(given)):
        return Path(given)
    try:
        folder = crane_machines.folder(machine or DEFAULT_MACHINE)
    except crane_machines.NoSuchMachineError as error:
        raise ConfigurationError(str(error)) from None
    if name == crane_machines.MACHINE_FILE and Path(machine or "").is_file():
        return Path(machine or "")  # whatever it is called
    path = folder / (given or name)
    if given and not path.suffix:
        path = path.with_suffix(".yaml")
    if not path.is_file():
        there = ", ".join(sorted(one.name for one in folder.iterdir() if one.is_file()))
        raise ConfigurationError(
            f"{path}: no such file of the machine (it has {there}); write it there, or name "
            f"another one"
        )
    return path
