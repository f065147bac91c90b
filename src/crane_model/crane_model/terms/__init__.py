"""The terms that a model is a sum of: one small class each, grouped in files by family.

Importing this package imports every file of it, and every entry point `crane_model.terms` of
other packages, which fills the registry: a new effect is one new class, registered by its `type`.
"""

from importlib import import_module
from pkgutil import iter_modules

from crane_model.terms.joint_term import JointMemoryTerm, JointTerm, MemoryTerm, OneJointTerm
from crane_model.terms.nonparametric import NONPARAMETRIC_TERMS, NonparametricTerm
from crane_model.terms.term import (
    REGISTRY,
    Effect,
    Family,
    NonparametricCurve,
    Parameter,
    Setting,
    Shape,
    Term,
    candidates,
    joints_of,
    load_installed,
    load_terms,
    nuisances,
    term_from_mapping,
    typical,
    unlisted_signatures,
)

__all__ = [
    "NONPARAMETRIC_TERMS",
    "REGISTRY",
    "Effect",
    "Family",
    "JointMemoryTerm",
    "JointTerm",
    "MemoryTerm",
    "NonparametricCurve",
    "NonparametricTerm",
    "OneJointTerm",
    "Parameter",
    "Setting",
    "Shape",
    "Term",
    "candidates",
    "joints_of",
    "load_terms",
    "nuisances",
    "term_from_mapping",
    "typical",
    "unlisted_signatures",
]

for _file in iter_modules(__path__):  # last: the terms may import all that stands above
    import_module(f"{__name__}.{_file.name}")
load_installed()
