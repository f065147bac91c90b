"""Where the files of a machine are: all in one folder, beside its machine file."""

import json
import math
from collections.abc import Mapping, Sequence
from numbers import Real
from pathlib import Path
from typing import Annotated, Any, Self, TypeVar

from pydantic import BaseModel, BeforeValidator, ConfigDict, ValidationError

import crane_machines
from crane_model.errors import ConfigurationError, DataError

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


# Files that programs write for programs, in JSON: each is written and read by its one schema.


def _finite(value: Any) -> Any:
    """JSON has neither NaN nor infinity."""
    if not isinstance(value, Real):
        return value
    return float(value) if math.isfinite(value) else None


Number = Annotated[float | None, BeforeValidator(_finite)]
"""A number, or null where there is none; NaN and infinity become null."""
NumberByJoint = dict[str, Number]


class ResultPart(BaseModel):
    """Base of everything that stands in such a file.

    The docstring of a field says what it means, and that of a number its unit: [m], [-] for a
    ratio, [unit] where a field beside it holds it.
    """

    model_config = ConfigDict(
        frozen=True, extra="forbid", allow_inf_nan=False, use_attribute_docstrings=True
    )

    def plain(self) -> dict[str, Any]:
        """The content as JSON has it: mappings, lists, texts, numbers, null."""
        return self.model_dump(mode="json")


class ResultFile(ResultPart):
    """Base of such a file.

    >>> class Weight(ResultFile):
    ...     mass: Number
    >>> Weight(mass=float("nan")).plain()
    {'mass': None}
    """

    def write(self, path: Path | str) -> None:
        """Write the file; what stands there is replaced."""
        text = json.dumps(self.plain(), indent=2, ensure_ascii=False, allow_nan=False)
        Path(path).write_text(text + "\n", encoding="utf-8")

    @classmethod
    def read(cls, path: Path | str) -> Self:
        """Read a file; `DataError` if it is absent, or is not of this kind."""
        try:
            return cls.model_validate_json(Path(path).read_text(encoding="utf-8"))
        except FileNotFoundError:
            folder, name = Path(path).parent, Path(path).name
            advice = (
                f"{folder} holds no {name}, give a folder that does"
                if folder.is_dir()
                else "check the path"
            )
            raise DataError(f"{path}: no such file; {advice}") from None
        except ValidationError as error:
            first = error.errors(include_url=False)[0]
            place = ".".join(map(str, first["loc"])) or "whole file"
            raise DataError(
                f"{path}: not what this version writes: key '{place}': {first['msg']}; write it "
                "again with this version"
            ) from None
        except (OSError, ValueError) as error:
            raise DataError(f"{path}: not readable: {error}; write it again") from None
