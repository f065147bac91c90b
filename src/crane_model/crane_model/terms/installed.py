"""Terms of other packages, found by their entry points."""

from crane_model import registry
from crane_model.terms.term import REGISTRY, Term

GROUP = "crane_model.terms"


def load_installed() -> tuple[type[Term], ...]:
    """Register the terms of every installed package with an entry point of `GROUP`."""
    return registry.load_installed(GROUP, REGISTRY, "a term")
