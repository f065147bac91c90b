"""The terms that a model is a sum of: one small class each, grouped in files by family.

Importing this package imports every file of it, and every entry point `crane_model.terms` of
other packages, which fills the registry: a new effect is one new class, registered by its `type`.
"""

from importlib import import_module
from pkgutil import iter_modules

from crane_model.terms.catalogue import candidates, joints_of, nuisances, strangers, typical
from crane_model.terms.drawn import DRAWING, DrawnTerm
from crane_model.terms.effect import DrawnCurve, Effect, Shape
from crane_model.terms.installed import load_installed
from crane_model.terms.joint_term import JointTerm, OneJointTerm
from crane_model.terms.memory_term import JointMemoryTerm, MemoryTerm
from crane_model.terms.own import load_terms
from crane_model.terms.term import REGISTRY, Family, Parameter, Setting, Term, term_from_mapping

__all__ = [
    "DRAWING",
    "REGISTRY",
    "DrawnCurve",
    "DrawnTerm",
    "Effect",
    "Family",
    "JointMemoryTerm",
    "JointTerm",
    "MemoryTerm",
    "OneJointTerm",
    "Parameter",
    "Setting",
    "Shape",
    "Term",
    "candidates",
    "joints_of",
    "load_terms",
    "nuisances",
    "strangers",
    "term_from_mapping",
    "typical",
]

for _file in iter_modules(__path__):  # last: the terms may import all that stands above
    import_module(f"{__name__}.{_file.name}")
load_installed()
