"""How the rooms of the suite import each other, read from the source.

A room is a folder; at the root of a package each module is a room of its own. An arrow leads from a
room to another one that it imports, and up where a package imports one that it must not. A room
stands one floor above the highest of its package that it imports; rooms that import each other in a
circle share one. `python -m from_code.imports ROOT` prints the numbers of the clone at ROOT.
"""

import ast
import sys
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from graphlib import TopologicalSorter
from pathlib import Path

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components

from crane_benchmark.measured import MeasuredRow

# What is identified is judged against crane_sim: crane_model and crane_identification share
# nothing with it.
MAY_IMPORT: Mapping[str, frozenset[str]] = {
    package: frozenset(others.split())
    for package, others in {
        "crane_machines": "",
        "crane_model": "crane_machines",
        "crane_bags": "crane_model",
        "crane_nodes": "crane_model crane_bags",
        "crane_driver": "crane_model crane_bags crane_nodes",
        "crane_trajectory": "crane_model crane_nodes",
        "crane_sim": "crane_model crane_bags crane_nodes crane_driver crane_trajectory",
        "crane_observer": "crane_model crane_bags crane_nodes",
        "crane_identification": "crane_model crane_bags crane_nodes crane_observer",
        "crane_viewer": "crane_model crane_bags crane_nodes",
        "crane_benchmark": (
            "crane_model crane_bags crane_nodes crane_driver crane_sim crane_trajectory "
            "crane_identification crane_observer"
        ),
    }.items()
}
COLUMNS = (
    "package",
    "modules",
    "rooms",
    "arrows between them",
    "floors",
    "rooms in circles",
    "arrows to other packages",
    "of these up",
)


def room_of(module: str) -> str:
    """The folder of a module, or itself at the root of a package."""
    parts = module.split(".")
    return module if len(parts) == 2 else ".".join(parts[:-1])


def package_of(name: str) -> str:
    """Of a room or a module."""
    return name.partition(".")[0]


@dataclass(frozen=True)
class Imports:
    """All modules of a clone by name, with their files."""

    modules: Mapping[str, Path]

    @classmethod
    def of(cls, root: Path) -> "Imports":
        """Those of all Python packages in the clone at `root`."""
        folders = [
            path.parent / path.parent.name
            for pattern in ("*/setup.py", "src/*/setup.py")
            for path in sorted(root.glob(pattern))
        ]
        return cls(
            {
                ".".join((folder.name, *file.relative_to(folder).with_suffix("").parts)): file
                for folder in folders
                for file in sorted(folder.rglob("*.py"))
                if file.stem != "__init__"
            }
        )

    @cached_property
    def packages(self) -> list[str]:
        """From the lowest up."""
        return [one for one in MAY_IMPORT if any(package_of(m) == one for m in self.modules)]

    @cached_property
    def rooms(self) -> dict[str, set[str]]:
        """Which rooms each room imports, without itself."""
        rooms: dict[str, set[str]] = {}
        for module, file in self.modules.items():
            found = rooms.setdefault(room_of(module), set())
            found |= {room_of(name) for name in _imported(file) if name in self.modules}
        return {room: others - {room} for room, others in rooms.items()}

    def within(self, package: str) -> dict[str, set[str]]:
        """The rooms of a package, and what they import of it."""
        own = {room for room in self.rooms if package_of(room) == package}
        return {room: self.rooms[room] & own for room in sorted(own)}

    def leaving(self, package: str) -> list[tuple[str, str]]:
        """The arrows from rooms of a package to those of others."""
        return [
            (room, other)
            for room in self.within(package)
            for other in sorted(self.rooms[room])
            if package_of(other) != package
        ]

    def rows(self) -> Iterator[MeasuredRow]:
        """Numbers of each package, and of all."""
        total: dict[str, float] = {}
        for package in self.packages:
            rooms, leaving = self.within(package), self.leaving(package)
            circles = _circles(rooms)
            numbers = {
                "modules": sum(package_of(one) == package for one in self.modules),
                "rooms": len(rooms),
                "arrows": sum(map(len, rooms.values())),
                "floors": 1 + max(floors(rooms).values(), default=0),
                "circling": sum(len(one) for one in circles if len(one) > 1),
                "leaving": len(leaving),
                "up": sum(is_up(*arrow) for arrow in leaving),
            }
            total = {name: total.get(name, 0) + n for name, n in numbers.items()}
            yield _row(f"`{package}`", {name: float(n) for name, n in numbers.items()})
        yield _row("all", total | {"floors": 1.0 + max(floors(self.rooms).values(), default=0)})


def is_up(room: str, other: str) -> bool:
    """Whether an arrow leads to a package that must not be imported from here."""
    package, imported = package_of(room), package_of(other)
    return imported != package and imported not in MAY_IMPORT[package]


def floors(rooms: Mapping[str, set[str]]) -> dict[str, int]:
    """The floor of each room, 0 for those that import none of these."""
    circles = _circles(rooms)
    place = {room: number for number, circle in enumerate(circles) for room in circle}
    below = {
        number: {place[other] for room in circle for other in rooms[room]} - {number}
        for number, circle in enumerate(circles)
    }
    height: dict[int, int] = {}
    for number in TopologicalSorter(below).static_order():
        height[number] = max((height[other] + 1 for other in below[number]), default=0)
    return {room: height[number] for room, number in place.items()}


def _circles(rooms: Mapping[str, set[str]]) -> list[list[str]]:
    """The rooms in groups that import each other, directly or by others; most of one room."""
    names = list(rooms)
    number = {name: i for i, name in enumerate(names)}
    pairs = [(number[name], number[other]) for name in names for other in rooms[name]]
    starts, ends = np.array(pairs, dtype=int).reshape(-1, 2).T
    matrix = csr_array((np.ones(len(pairs)), (starts, ends)), shape=(len(names), len(names)))
    count, label = connected_components(matrix, connection="strong")
    return [[names[i] for i in np.flatnonzero(label == k)] for k in range(count)]


def _imported(file: Path) -> Iterator[str]:
    """Names that may be those of modules."""
    for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
        if isinstance(node, ast.ImportFrom) and node.level == 0:
            yield str(node.module)
            yield from (f"{node.module}.{alias.name}" for alias in node.names)
        elif isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)


def _row(name: str, values: Mapping[str, float]) -> MeasuredRow:
    cells = [name, *(f"{{{key}:.0f}}" for key in values)]
    return MeasuredRow(cells=cells, values=dict(values))


if __name__ == "__main__":
    for line in (COLUMNS, *(row.shown for row in Imports.of(Path(sys.argv[1])).rows())):
        print(" | ".join(line))
