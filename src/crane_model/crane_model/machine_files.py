"""Files of a machine: all in one folder, beside its machine file."""

from collections.abc import Mapping, Sequence
from hashlib import sha256
from pathlib import Path
from typing import TypeVar

import crane_machines
from crane_model.errors import ConfigurationError

DEFAULT_MACHINE = crane_machines.DEFAULT
MACHINE_SUFFIXES = (".yaml", ".dbc", ".eds")
"""Suffixes of the files in a machine's folder that the suite reads."""


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
        there = ", ".join(sorted(file.name for file in folder.iterdir() if file.is_file()))
        raise ConfigurationError(
            f"{path}: no such file of the machine (it has {there}); write it there, or name "
            f"another one"
        )
    return path


def machine_digest(machine: Path | str | None = None) -> str:
    """SHA-256 of all files in the folder of a machine, as `machine_file` takes it."""
    folder = machine_file(crane_machines.MACHINE_FILE, machine).parent
    digest = sha256()
    for path in sorted(path for path in folder.iterdir() if path.suffix in MACHINE_SUFFIXES):
        content = path.read_bytes()
        digest.update(f"{path.name} {len(content)}\n".encode() + content)
    return digest.hexdigest()


# Tables with an entry for each joint of a machine, as files hold them.

Entry = TypeVar("Entry")


def of_every_joint(
    table: Mapping[str, Entry], joints: Sequence[str], where: str
) -> dict[str, Entry]:
    """`table` in the order of a machine's `joints`; `where` it stands is for errors: file and key.

    `ConfigurationError` if a joint has no entry, or an entry is of no joint of the machine.
    """
    missing = [joint for joint in joints if joint not in table]
    unknown = [joint for joint in table if joint not in joints]
    problems = [f"no entry for {', '.join(missing)}"] * bool(missing)
    problems += [f"no joint {', '.join(unknown)}"] * bool(unknown)
    if problems:
        raise ConfigurationError(
            f"{where}: {' and '.join(problems)}; the machine has the joints {', '.join(joints)}"
        )
    return {joint: table[joint] for joint in joints}
