"""What makes the parameters of a model physical: signs, friction in both directions, bodies."""

from dataclasses import dataclass

import numpy as np

from crane_model.base_parameters import STANDARD_PARAMETERS, lagrangian_from_standard
from crane_model.dynamics import Geometry
from crane_model.model_file import Model
from crane_model.terms.rigid_body import PlanarRigidBody

BODIES = ("inner boom", "outer boom", "telescope and gripper")
ASYMMETRIES = (("f_c", "df_c"), ("f_v", "df_v"))


@dataclass(frozen=True)
class Inequality:
    """`weights` · Θ >= `least`, in words `name`."""

    name: str
    weights: np.ndarray  # (p,)
    least: float


@dataclass(frozen=True)
class Bodies:
    """The planar bodies behind the base parameters Θ[`part`].

    `base` (8, 12) @ standard parameters gives them, for any bodies for which `none` (12,) @
    standard parameters is 0 (the centre of mass of telescope and gripper is on its axis).
    """

    part: slice
    base: np.ndarray
    none: np.ndarray


@dataclass(frozen=True)
class Physics:
    """All that physics asks of Θ (p,)."""

    inequalities: tuple[Inequality, ...]
    bodies: Bodies | None

    def violated(self, values: np.ndarray) -> list[str]:
        """Names of the inequalities that `values` (p,) do not keep."""
        return [one.name for one in self.inequalities if one.weights @ values < one.least]


def physics(model: Model) -> Physics:
    """Minimum of every parameter, friction (13) that brakes in both directions, and the bodies."""
    names = [parameter.name for parameter in model.parameters]
    unit = np.eye(len(names))
    inequalities = [
        Inequality(f"{parameter.name} >= {parameter.minimum:g}", unit[i], parameter.minimum)
        for i, parameter in enumerate(model.parameters)
        if parameter.minimum is not None
    ]
    for mean, asymmetry in ASYMMETRIES:
        for joint in model.joints:
            pair = f"{mean}.{joint}", f"{asymmetry}.{joint}"
            if set(pair) <= set(names):
                one, other = (unit[names.index(name)] for name in pair)
                inequalities += [
                    Inequality(f"{pair[0]} + {pair[1]} >= 0", one + other, 0.0),
                    Inequality(f"{pair[0]} - {pair[1]} >= 0", one - other, 0.0),
                ]
    return Physics(tuple(inequalities), _bodies(model))


def _bodies(model: Model) -> Bodies | None:
    for term in model.terms:
        if isinstance(term, PlanarRigidBody):
            assert model.machine is not None  # the term refuses such a model
            geometry = Geometry.of(model.machine)
            lagrangian = lagrangian_from_standard(geometry)
            mass = STANDARD_PARAMETERS.index("m_TG")
            none = lagrangian[8] - geometry.telescope_offset * np.eye(12)[mass]
            return Bodies(model.part(term), lagrangian[:8], none)
    return None
