"""Imports between the components of the suite, read from the source.

A component is a folder, or a module at the root of a package. An arrow leads from a component to
another one that it imports, and up if a package imports one that it must not. A component stands
one floor above the highest of its package that it imports; components in a cycle share one.
`python -m from_code.imports ROOT` prints the numbers of the clone at ROOT.
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
    "components",
    "arrows between them",
    "layers",
    "components in cycles",
    "arrows to other packages",
    "of these upwards",
)


def component_of(module: str) -> str:
    """The folder of a module, or itself at the root of a package."""
    parts = module.split(".")
    return module if len(parts) == 2 else ".".join(parts[:-1])


def package_of(name: str) -> str:
    """Package of a component or a module."""
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
    def components(self) -> dict[str, set[str]]:
        """The components that each component imports, without itself."""
        components: dict[str, set[str]] = {}
        for module, file in self.modules.items():
            found = components.setdefault(component_of(module), set())
            found |= {component_of(name) for name in _imported(file) if name in self.modules}
        return {component: others - {component} for component, others in components.items()}

    def within(self, package: str) -> dict[str, set[str]]:
        """The components of a package, and what they import of it."""
        own = {component for component in self.components if package_of(component) == package}
        return {component: self.components[component] & own for component in sorted(own)}

    def leaving(self, package: str) -> list[tuple[str, str]]:
        """The arrows from components of a package to those of others."""
        return [
            (component, other)
            for component in self.within(package)
            for other in sorted(self.components[component])
            if package_of(other) != package
        ]

    def rows(self) -> Iterator[MeasuredRow]:
        """Numbers of each package, and of all."""
        total: dict[str, float] = {}
        for package in self.packages:
            components, leaving = self.within(package), self.leaving(package)
            cycles = _cycles(components)
            numbers = {
                "modules": sum(package_of(one) == package for one in self.modules),
                "components": len(components),
                "arrows": sum(map(len, components.values())),
                "floors": 1 + max(floors(components).values(), default=0),
                "in_cycles": sum(len(one) for one in cycles if len(one) > 1),
                "leaving": len(leaving),
                "up": sum(is_up(*arrow) for arrow in leaving),
            }
            total = {name: total.get(name, 0) + n for name, n in numbers.items()}
            yield _row(f"`{package}`", {name: float(n) for name, n in numbers.items()})
        yield _row(
            "all", total | {"floors": 1.0 + max(floors(self.components).values(), default=0)}
        )


def is_up(component: str, other: str) -> bool:
    """Return whether an arrow leads to a package that must not be imported from here."""
    package, imported = package_of(component), package_of(other)
    return imported != package and imported not in MAY_IMPORT[package]


def floors(components: Mapping[str, set[str]]) -> dict[str, int]:
    """The floor of each component, 0 for those that import none of these."""
    cycles = _cycles(components)
    place = {component: number for number, cycle in enumerate(cycles) for component in cycle}
    below = {
        number: {place[other] for component in cycle for other in components[component]} - {number}
        for number, cycle in enumerate(cycles)
    }
    height: dict[int, int] = {}
    for number in TopologicalSorter(below).static_order():
        height[number] = max((height[other] + 1 for other in below[number]), default=0)
    return {component: height[number] for component, number in place.items()}


def _cycles(components: Mapping[str, set[str]]) -> list[list[str]]:
    """The components in groups that import each other, directly or indirectly; most are alone."""
    names = list(components)
    number = {name: i for i, name in enumerate(names)}
    pairs = [(number[name], number[other]) for name in names for other in components[name]]
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
