"""The machines that ship with the suite. Each is one folder of files, named after it:

machine.yaml, and what the suite needs to know of the machine beside its geometry: model.yaml,
joints.yaml, sensors.yaml, can.yaml and can.dbc, safety.yaml, controller.yaml, clearance.yaml,
design.yaml, its trajectories, hydraulics.yaml, simulated_crane.yaml of the simulated one, and
work.yaml if an operator is to work with it.
"""

from importlib.resources import files
from pathlib import Path

MACHINE_FILE = "machine.yaml"  # what makes a folder the folder of a machine
DEFAULT = "laboratory_crane"


class NoSuchMachineError(LookupError):
    """Neither the name of a shipped machine, nor a folder or file of another one."""


def shipped() -> tuple[str, ...]:
    """Names of the machines that ship with the suite."""
    return tuple(sorted(path.parent.name for path in _here().glob(f"*/{MACHINE_FILE}")))


def folder(machine: str | Path = DEFAULT) -> Path:
    """The folder of a machine, given by its name, its folder, or its machine file.

    A shipped machine comes before a folder of the same name (write `./NAME` for that one).
    `NoSuchMachineError` lists the shipped machines.

    >>> folder("laboratory_crane").name
    'laboratory_crane'
    """
    if str(machine) in shipped():
        return _here() / machine
    path = Path(machine)
    if path.is_file():
        return path.parent
    if (path / MACHINE_FILE).is_file():
        return path
    raise NoSuchMachineError(
        f"{machine}: no such machine; must be one of those that ship with the suite "
        f"({', '.join(shipped())}), a folder with a {MACHINE_FILE}, or a machine file"
    )


def _here() -> Path:
    return Path(str(files(__name__)))
