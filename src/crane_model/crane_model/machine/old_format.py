"""What to write in the place of a machine file that knows one crane only."""

from typing import Any

_OLD = ("denavit_hartenberg", "limits", "inner_boom_linkage", "outer_boom_linkage", "cylinders")


def what_to_write(content: Any) -> str:
    """How the keys of the old format are called now; empty for a file that has none of them."""
    found = [key for key in _OLD if isinstance(content, dict) and key in content]
    if not found or "joints" in content:
        return ""
    return (
        f"{', '.join(found)}: an older kind of machine file; write a list `joints:` now, from the "
        "base to the tip, each with `name`, `kind` (revolute or prismatic), `dh` (its row of "
        "Table 1: theta, d, a, alpha), `limits` (as before) and `actuator` (`type` with the areas "
        "and lengths of its cylinder and the constants of its linkage), as in machine.yaml of the "
        "laboratory crane"
    )
