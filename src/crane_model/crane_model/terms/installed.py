"""Terms of other packages, found by their entry points."""

import warnings
from importlib.metadata import EntryPoint, entry_points

from crane_model.terms.term import REGISTRY, Term

GROUP = "crane_model.terms"


def load_installed() -> tuple[type[Term], ...]:
    """Register the terms of every installed package with an entry point of `GROUP`.

    An entry point names a module, whose terms are registered by being imported, or one class of it.
    One that cannot be imported, or takes a type that exists, is left out with a warning, so that it
    stops nobody who does not need it.
    """
    before = set(REGISTRY)
    for point in sorted(entry_points(group=GROUP)):
        if reason := _refused(point):
            package = point.dist.name if point.dist else "a package"
            warnings.warn(
                f"{package}: entry point '{point.name}' of {GROUP} is left out: {reason}; mend or "
                "uninstall it",
                stacklevel=2,
            )
    return tuple(REGISTRY[name] for name in REGISTRY if name not in before)


def _refused(point: EntryPoint) -> str:
    """Why its terms were not registered; empty if they were."""
    before = dict(REGISTRY)
    try:
        point.load()
    except Exception as error:  # whatever stands in the package
        reason = f"{type(error).__name__}: {error}"
    else:
        taken = [name for name, term in before.items() if REGISTRY[name] is not term]
        if not taken:
            return ""
        reason = f"there is a term of type '{taken[0]}' already"
    REGISTRY.clear()
    REGISTRY.update(before)
    return reason
