"""Tables with an entry for each joint of a machine, as files hold them."""

from collections.abc import Mapping, Sequence
from typing import TypeVar

from crane_model.errors import ConfigurationError

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
