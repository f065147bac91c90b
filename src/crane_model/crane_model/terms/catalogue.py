"""The candidates for what a model lacks: every term of the registry that names an effect."""

import sys
from importlib import import_module
from pathlib import Path
from typing import Any

from crane_model import registry
from crane_model.errors import ConfigurationError
from crane_model.terms.term import REGISTRY, Setting, Term

# Terms of other packages, found by their entry points.

GROUP = "crane_model.terms"


def load_installed() -> tuple[type[Term], ...]:
    """Register the terms of every installed package with an entry point of `GROUP`."""
    return registry.load_installed(GROUP, REGISTRY, "a term")


# Terms of one's own, out of a Python file.


def load_terms(path: Path | str) -> tuple[type[Term], ...]:
    """Register the terms that a Python file defines, for model files, and as candidates.

    The file is imported under its name, and its folder stays on the path, so that other processes
    import it, too. `ConfigurationError` if it cannot be, defines none, or takes a type that exists.
    """
    path = Path(path).resolve()
    if path.suffix != ".py" or not path.is_file():
        raise ConfigurationError(f"{path}: no such Python file (.py); check the path")
    before = dict(REGISTRY)
    if str(path.parent) not in sys.path:
        sys.path.append(str(path.parent))
    try:
        module = import_module(path.stem)
    except Exception as error:  # whatever stands in the file
        raise ConfigurationError(f"{path}: {type(error).__name__}: {error}") from error
    if module.__file__ is None or Path(module.__file__).resolve() != path:
        raise ConfigurationError(
            f"{path}: '{path.stem}' is also the name of {module.__file__ or 'a module of Python'}; "
            "rename the file"
        )
    taken = [name for name, term in before.items() if REGISTRY[name] is not term]
    REGISTRY.update(before)
    if taken:
        raise ConfigurationError(
            f"{path}: there is a term of type '{taken[0]}' already; choose another type"
        )
    terms = tuple(term for term in REGISTRY.values() if term.__module__ == path.stem)
    if not terms:
        raise ConfigurationError(
            f"{path}: defines no term; derive a class from crane_model.terms.JointTerm"
        )
    return terms


def candidates(setting: Setting) -> list[type[Term]]:
    """Terms with an `effect` that a model of this setting can hold, in the order of their types."""
    return [cls for cls in _sorted() if cls.effect is not None and _held(cls, setting)]


def nuisances(setting: Setting) -> list[type[Term]]:
    """Terms that stand for errors of the data and that a model of this setting can hold."""
    return [cls for cls in _sorted() if cls.nuisance and _held(cls, setting)]


def strangers(setting: Setting, joint: str) -> list[Term]:
    """On a joint, the signatures that no effect has."""
    return [
        typical(cls, joint)
        for cls in _sorted()
        if cls.stranger and joint in joints_of(cls, setting)
    ]


def joints_of(cls: type[Term], setting: Setting) -> tuple[str, ...]:
    """The joints on which the term can act; empty for a term of the whole machine."""
    return tuple(
        joint
        for joint in cls.places(setting)
        if joint is not None and _accepted(cls, setting, joint)
    )


def typical(cls: type[Term], joint: str | None = None) -> Term:
    """The term with each shape parameter in the middle of its range, on `joint` if it has one.

    Constants that a model must give are those of their examples.
    """
    given = {name: one.examples[0] for name, one in cls.model_fields.items() if one.examples}
    shapes: dict[str, Any] = {
        field: float(shape.grid[shape.points // 2]) for field, shape in cls.shapes.items()
    }
    return cls(**given, **shapes, **({} if joint is None else {"joint": joint}))


def _sorted() -> list[type[Term]]:
    return [REGISTRY[name] for name in sorted(REGISTRY)]


def _held(cls: type[Term], setting: Setting) -> bool:
    return any(_accepted(cls, setting, joint) for joint in cls.places(setting))


def _accepted(cls: type[Term], setting: Setting, joint: str | None) -> bool:
    try:
        typical(cls, joint).parameters(setting)
    except ConfigurationError:
        return False
    return True
