"""Names that a package imports when they are first used, as numba and SciPy take seconds."""

from collections.abc import Callable
from importlib import import_module
from typing import Any


def importer(package: str, homes: dict[str, str]) -> Callable[[str], Any]:
    """A `__getattr__` for the `__init__` of `package`; `homes` are the modules of its names."""

    def get(name: str) -> Any:
        if name not in homes:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        return getattr(import_module(f"{package}.{homes[name]}"), name)

    return get
