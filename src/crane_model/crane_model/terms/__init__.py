"""The terms that a model is a sum of: one small class each, grouped in files by family.

Importing this package fills the registry; a new effect is one new class, registered by its `type`.
"""

from crane_model.terms import friction, presliding, rigid_body, single_axis
from crane_model.terms.effect import Effect, Shape
from crane_model.terms.joint_term import JointTerm, MemoryTerm, OneJointTerm
from crane_model.terms.term import REGISTRY, Parameter, Term, term_from_mapping

__all__ = [
    "REGISTRY",
    "Effect",
    "JointTerm",
    "MemoryTerm",
    "OneJointTerm",
    "Parameter",
    "Shape",
    "Term",
    "friction",
    "presliding",
    "rigid_body",
    "single_axis",
    "term_from_mapping",
]
