"""Writes the pages made from the code into the folder named by the only argument."""

import sys
from pathlib import Path

from from_code import (
    api,
    chart,
    command_line,
    faults,
    files,
    imports_picture,
    machines,
    messages,
    nodes,
    result_files,
    system_picture,
)

MODULES = (
    *(command_line, nodes, messages, faults, files, result_files, api, imports_picture),
    *(chart, machines, system_picture),
)


def main(folder: Path) -> None:
    """Write what has changed, remove what is no longer made."""
    made: dict[str, str] = {}
    for module in MODULES:
        made |= module.pages()
    folder.mkdir(exist_ok=True)
    for path in folder.iterdir():
        if path.name not in made:
            path.unlink()
    for name, text in made.items():
        path = folder / name
        if not path.is_file() or path.read_text("utf-8") != text:  # else Sphinx reads it again
            path.write_text(text, "utf-8")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
