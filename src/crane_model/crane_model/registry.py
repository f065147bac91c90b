"""Kinds of things that other packages may add to: found by their entry points, chosen by `type`."""

import warnings
from collections.abc import Mapping
from importlib.metadata import EntryPoint, entry_points
from typing import Any, TypeVar

from crane_model.configuration import Schema

Kind = TypeVar("Kind", bound=Schema)


def load_installed(
    group: str, registry: dict[str, type[Kind]], what: str
) -> tuple[type[Kind], ...]:
    """Register what every installed package with an entry point of `group` has; `what` names it.

    An entry point names a module, whose classes are registered by being imported, or one class of
    it. One that cannot be imported, or takes a type that exists, is left out with a warning, so
    that it stops nobody who does not need it.
    """
    before = set(registry)
    for point in sorted(entry_points(group=group)):
        if reason := _refused(point, registry, what):
            package = point.dist.name if point.dist else "a package"
            warnings.warn(
                f"{package}: entry point '{point.name}' of {group} is left out: {reason}; mend or "
                "uninstall it",
                stacklevel=2,
            )
    return tuple(registry[name] for name in registry if name not in before)


def of_type(content: Any, registry: Mapping[str, type[Kind]], what: str, more: str) -> Kind:
    """The entry of a file that names its `type`; raises ValueError as pydantic wants it.

    `what` it is, and where `more` types come from, is for the message.
    """
    name = content.get("type") if isinstance(content, Mapping) else None
    if not isinstance(name, str) or name not in registry:
        known = ", ".join(sorted(registry))
        raise ValueError(f"no {what} of type {name!r}; there are {known}, {more}")
    return registry[name].model_validate(content)


def _refused(point: EntryPoint, registry: dict[str, type[Kind]], what: str) -> str:
    """Why its classes were not registered; empty if they were."""
    before = dict(registry)
    try:
        point.load()
    except Exception as error:  # whatever stands in the package
        reason = f"{type(error).__name__}: {error}"
    else:
        taken = [name for name, known in before.items() if registry[name] is not known]
        if not taken:
            return ""
        reason = f"there is {what} of type '{taken[0]}' already"
    registry.clear()
    registry.update(before)
    return reason
