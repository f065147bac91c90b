"""Executables that are now in crane_nodes: for one release they work here too, and say so."""

import sys
from collections.abc import Sequence

from crane_nodes.recording import player as player_module
from crane_nodes.recording import recorder as recorder_module
from crane_nodes.recording import recover as recover_module


def player(argv: Sequence[str] | None = None) -> int:
    """`ros2 run crane_driver player`."""
    _tell("player")
    return player_module.main(argv)


def recorder(argv: Sequence[str] | None = None) -> int:
    """`ros2 run crane_driver recorder`."""
    _tell("recorder")
    return recorder_module.main(argv)


def recover(argv: Sequence[str] | None = None) -> int:
    """`ros2 run crane_driver recover`."""
    _tell("recover")
    return recover_module.main(argv)


def _tell(name: str) -> None:
    print(
        f"{name} has moved to crane_nodes, and will be found there only from the next release on: "
        f"ros2 run crane_nodes {name}",
        file=sys.stderr,
    )
