"""The terms that a model is a sum of: one small class each, grouped in files by family.

Importing this package fills the registry; a new effect is one new class, registered by its `type`.
"""

from crane_model.terms import (
    actuator,
    backlash,
    elasticity,
    friction,
    friction_load,
    friction_position,
    friction_speed,
    friction_temperature,
    gravity_and_load,
    maxwell_slip,
    nuisance,
    presliding,
    rigid_body,
    sensing,
    single_axis,
    stiction,
    swinging_load,
)
from crane_model.terms.catalogue import candidates, joints_of, nuisances, typical
from crane_model.terms.effect import Effect, Shape
from crane_model.terms.joint_term import JointTerm, OneJointTerm
from crane_model.terms.memory_term import JointMemoryTerm, MemoryTerm
from crane_model.terms.own import load_terms
from crane_model.terms.term import REGISTRY, Family, Parameter, Setting, Term, term_from_mapping

__all__ = [
    "REGISTRY",
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
    "actuator",
    "backlash",
    "candidates",
    "elasticity",
    "friction",
    "friction_load",
    "friction_position",
    "friction_speed",
    "friction_temperature",
    "gravity_and_load",
    "joints_of",
    "load_terms",
    "maxwell_slip",
    "nuisance",
    "nuisances",
    "presliding",
    "rigid_body",
    "sensing",
    "single_axis",
    "stiction",
    "swinging_load",
    "term_from_mapping",
    "typical",
]
