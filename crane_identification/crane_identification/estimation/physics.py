"""What makes the parameters of a model physical: signs, friction in both directions, bodies."""

from dataclasses import dataclass

import numpy as np

from crane_model.base_parameters import STANDARD_PARAMETERS, lagrangian_from_standard
from crane_model.chain import PER_BODY, TEN_FROM_PSEUDO_INERTIA
from crane_model.dynamics import Geometry
from crane_model.errors import ConfigurationError
from crane_model.machine import Machine
from crane_model.model_file import Model
from crane_model.record import Record
from crane_model.terms import Term
from crane_model.terms.rigid_body import RotorInertia

BODIES = ("inner boom", "outer boom", "telescope and gripper")
STATES = 100  # random ones that show whether a rotor is told from bodies
ALIKE = 1e-6  # share of a column's norm


@dataclass(frozen=True)
class Inequality:
    """`weights` · Θ >= `least`, in words `name`."""

    name: str
    weights: np.ndarray  # (p,)
    least: float


@dataclass(frozen=True)
class Bodies:
    """The k bodies behind the base parameters Θ[`part`], each by its pseudo-inertia P (d, d).

    A body has s standard parameters, `moments` (s, d, d) : P. `base` (r, k s) @ those of all bodies
    gives Θ[`part`], for any bodies for which `none` (c, k s) @ standard parameters is 0. To these
    `rotors` (r, l) adds, times an inertia of at least 0 each, those of drives that the machine has
    and the model lacks, if forces cannot tell them from bodies. A body of 1 kg has P about the
    square of `size` (d,), on its diagonal. P is positive definite where `definite` (k,), elsewhere
    at least not negative.
    """

    part: slice
    names: tuple[str, ...]
    moments: np.ndarray
    base: np.ndarray
    none: np.ndarray
    rotors: np.ndarray
    size: np.ndarray
    definite: np.ndarray

    @property
    def in_space(self) -> bool:
        """Whether bodies have all ten parameters; else they are planar."""
        return self.moments.shape[1] == 4


@dataclass(frozen=True)
class Physics:
    """All that physics asks of Θ (p,)."""

    inequalities: tuple[Inequality, ...]
    bodies: Bodies | None

    def violated(self, values: np.ndarray) -> list[str]:
        """Names of the inequalities that `values` (p,) do not keep."""
        return [one.name for one in self.inequalities if one.weights @ values < one.least]


def physics(model: Model, bodies_in_space: bool = True) -> Physics:
    """Minimum of every parameter, friction (13) that brakes in both directions, and the bodies.

    Without `bodies_in_space`, of bodies only those of a planar crane.
    """
    names = [parameter.name for parameter in model.parameters]
    unit, bodies = np.eye(len(names)), _bodies(model, bodies_in_space)
    # Minima of a body in space follow from its pseudo-inertia.
    implied = range(len(names))[bodies.part] if bodies and bodies.in_space else range(0)
    inequalities = [
        Inequality(f"{parameter.name} >= {parameter.minimum:g}", unit[i], parameter.minimum)
        for i, parameter in enumerate(model.parameters)
        if parameter.minimum is not None and i not in implied
    ]
    for mean, half in _asymmetries(model):
        inequalities += [
            Inequality(f"{names[mean]} + {names[half]} >= 0", unit[mean] + unit[half], 0.0),
            Inequality(f"{names[mean]} - {names[half]} >= 0", unit[mean] - unit[half], 0.0),
        ]
    return Physics(tuple(inequalities), bodies)


def _asymmetries(model: Model) -> list[tuple[int, int]]:
    """Where a mean of both directions and half their difference stand in Θ, joint by joint."""
    means = {(term.type, term.only_joint): model.part(term).start for term in model.terms}
    pairs = [
        (term.type, model.joints.index(term.only_joint), mean, model.part(term).start)
        for term in model.terms
        if term.asymmetry_of is not None
        and term.only_joint is not None
        and (mean := means.get((term.asymmetry_of, term.only_joint))) is not None
    ]
    return [(mean, half) for *_, mean, half in sorted(pairs)]


def _bodies(model: Model, in_space: bool) -> Bodies | None:
    if model.base_parameters is not None:
        return _in_the_plane(model, model.base_parameters)
    for term in model.terms if in_space else ():
        base = term.of_bodies(model.setting)
        if base is not None:
            return _in_space(model, term, base)
    return None


def _in_the_plane(model: Model, part: slice) -> Bodies:
    assert model.machine is not None  # the term of the base parameters refuses such a model
    geometry = Geometry.of(model.machine)
    lagrangian = lagrangian_from_standard(geometry)
    mass = STANDARD_PARAMETERS.index("m_TG")
    none = lagrangian[8:] - geometry.telescope_offset * np.eye(12)[[mass]]
    moments = np.zeros((4, 3, 3))
    moments[0, 2, 2] = moments[1, 0, 2] = moments[2, 1, 2] = 1.0
    moments[3, [0, 1], [0, 1]] = 1.0
    no_rotors, exist = np.zeros((8, 0)), np.ones(3, dtype=bool)
    return Bodies(part, BODIES, moments, lagrangian[:8], none, no_rotors, np.ones(3), exist)


def _in_space(model: Model, term: Term, base: np.ndarray) -> Bodies:
    machine = model.machine
    assert machine is not None  # a term of bodies refuses such a model
    names = tuple(joint.name for joint in machine.joints)
    chain = machine.chain
    links = np.linalg.norm([*chain.translation[1:], chain.tip_translation], axis=1)
    length = float(links.mean()) or 1.0
    ten = [f"{each}.{name}" for name in names for each in PER_BODY]
    zero = [ten.index(name) for name in term.zero_moments]
    # A body without mass, or without inertia about an axis, is at the edge of what there can be.
    definite = np.ones(len(names), dtype=bool)
    definite[[i // 10 for i in zero if PER_BODY[i % 10] in ("m", "Ixx", "Iyy", "Izz")]] = False
    return Bodies(
        model.part(term),
        names,
        TEN_FROM_PSEUDO_INERTIA,
        base,
        np.eye(len(ten))[zero],
        _hidden_rotors(model, term, machine),
        np.array([length, length, length, 1.0]),
        definite,
    )


def _hidden_rotors(model: Model, term: Term, machine: Machine) -> np.ndarray:
    """(r, l) parameters of the bodies of `term` that a rotor of 1 kg m² is taken for."""
    lacking = [
        joint
        for joint in machine.rotors
        if joint in model.joints and RotorInertia(joint=joint) not in model.terms
    ]
    motion = np.random.default_rng(0).standard_normal((3, STATES, len(model.joints)))
    record = Record(model.joints, np.arange(float(STATES)), *motion)
    columns = term.columns(record, model.setting)
    taken = np.zeros((columns.shape[2], 0))
    for joint in lacking:
        try:
            rotor = RotorInertia(joint=joint).columns(record, model.setting)
        except ConfigurationError:  # it also turns with joints that the model lacks
            continue
        alike = np.linalg.lstsq(columns.reshape(-1, columns.shape[2]), rotor.ravel(), rcond=None)[0]
        if np.linalg.norm(columns @ alike - rotor[:, :, 0]) < ALIKE * np.linalg.norm(rotor):
            taken = np.column_stack([taken, alike])
    return taken
