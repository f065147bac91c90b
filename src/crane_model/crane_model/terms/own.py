"""Terms of one's own, out of a Python file."""

import sys
from importlib import import_module
from pathlib import Path

from crane_model.errors import ConfigurationError
from crane_model.terms.term import REGISTRY, Term


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
