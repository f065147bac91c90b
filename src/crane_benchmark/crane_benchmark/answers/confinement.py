"""Keeps a process from what it must not see: files beside its own, and modules that know."""

import os
import sys
from collections.abc import Sequence
from pathlib import Path

READING = ("open", "os.listdir", "os.scandir")


class PeekError(Exception):
    """The answering process tried to look at what is sealed."""


def confine(root: Path, allowed: Sequence[Path], modules: Sequence[str]) -> None:
    """From now on nothing under `root` is opened or listed but what is in `allowed`, and none of
    the `modules`, or of what is in them, is imported, on pain of `PeekError`. There is no way back.
    """
    fence = _plain(root)
    inside = tuple(_plain(path) for path in allowed)

    def knows(name: str) -> bool:
        return any(name == one or name.startswith(f"{one}.") for one in modules)

    if known := sorted(filter(knows, sys.modules)):
        raise PeekError(f"imported already: {', '.join(known)}; confine the process before")

    def within(path: str, folder: str) -> bool:
        return path == folder or path.startswith(folder + os.sep)

    def watch(event: str, arguments: tuple) -> None:
        if event == "import" and knows(str(arguments[0])):
            raise PeekError(f"import of {arguments[0]}")
        if event in READING and isinstance(arguments[0], str | bytes | os.PathLike):
            path = _plain(arguments[0])
            if within(path, fence) and not any(within(path, folder) for folder in inside):
                raise PeekError(f"{event} of {path}")

    sys.addaudithook(watch)


def _plain(path: str | bytes | os.PathLike) -> str:
    """Absolute, without links: what an open would reach."""
    return os.path.realpath(os.fsdecode(path))
