"""A table of a machine with an entry for each of its joints, or for those that have one."""

from collections.abc import Mapping
from typing import TypeVar

from crane_model.errors import RangeError

Entry = TypeVar("Entry")


class ByJoint(dict[str, Entry]):
    """Entries by joint; `RangeError` names the joints that there are where one is not."""

    def __init__(self, machine: str, what: str, entries: Mapping[str, Entry | None]):
        """`what` the entries are, for the message."""
        super().__init__({joint: one for joint, one in entries.items() if one is not None})
        self._told = f"{machine}: {{}} has no {what}; there are those of {', '.join(self)}"

    def __missing__(self, joint: str) -> Entry:
        raise RangeError(self._told.format(f"'{joint}'"))
