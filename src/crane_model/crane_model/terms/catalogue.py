"""The candidates for what a model lacks: every term of the registry that names an effect."""

from typing import Any

from crane_model.errors import ConfigurationError
from crane_model.terms.term import REGISTRY, Setting, Term


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
