"""Rigid-body terms."""

from typing import ClassVar, Literal

import numpy as np

from crane_model.array import Array
from crane_model.base_parameters import lagrangian_from_standard, standard_from_chain
from crane_model.dynamics import Geometry, fill_base_regressor
from crane_model.dynamics_slopes import pull_back
from crane_model.record import Record
from crane_model.terms.planar import planar_columns, planar_machine
from crane_model.terms.term import Family, Parameter, Setting, Term


class PlanarRigidBody(Term):
    """M(q) q'' + C(q, q') q' + G(q) of (7), linear in the eight base parameters (8).

    The centre of mass of telescope and gripper lies on the telescope's axis, so that its normal
    moment about the elbow is a3 m_TL and not a parameter of its own.
    """

    type: Literal["planar_rigid_body"] = "planar_rigid_body"
    family: ClassVar[Family] = "rigid body"
    has_base_parameters: ClassVar[bool] = True
    of_one_instant: ClassVar[bool] = True

    def parameters(self, setting: Setting) -> tuple[Parameter, ...]:
        """The base set of the suite, each named as the combination that it is."""
        planar_machine(self, setting)
        return BASE_PARAMETERS

    def of_bodies(self, setting: Setting) -> Array | None:
        """The base set from the bodies of the chain."""
        machine = planar_machine(self, setting)
        lagrangian = lagrangian_from_standard(Geometry.of(machine))
        bodies: Array = lagrangian[: len(BASE_PARAMETERS)] @ standard_from_chain(machine)
        return bodies

    def fill(self, record: Record, setting: Setting, columns: Array) -> None:
        """On the rows of inner boom, outer boom and telescope."""
        geometry = Geometry.of(planar_machine(self, setting))
        motion = record.position, record.velocity, record.acceleration
        fill_base_regressor(geometry, *motion, planar_columns(setting, record), columns)

    def pull_back(self, record: Record, setting: Setting, weight: Array) -> Array:
        """In closed form."""
        geometry = Geometry.of(planar_machine(self, setting))
        at = planar_columns(setting, record)
        motion = record.position, record.velocity, record.acceleration
        q, v, acceleration = (each[:, at] for each in motion)
        slopes = np.zeros((3, *record.position.shape))
        slopes[:, :, at] = pull_back(geometry, q, v, acceleration, weight[:, at])
        return slopes


BASE_PARAMETERS = (
    Parameter(
        "J_FL",
        "kg m2",
        0.0,
        "inertia of the inner boom about joint 2 + a2^2 times the mass of outer boom, telescope "
        "and gripper",
    ),
    Parameter(
        "S_FL_along",
        "kg m",
        None,
        "mass moment of the inner boom along the line from joint 2 to the elbow + a2 times the "
        "mass of outer boom, telescope and gripper",
    ),
    Parameter("S_FL_normal", "kg m", None, "mass moment of the inner boom normal to that line"),
    Parameter(
        "J_SL",
        "kg m2",
        0.0,
        "inertia of outer boom, telescope and gripper about the elbow at q4 = 0",
    ),
    Parameter(
        "S_SL_along",
        "kg m",
        None,
        "mass moment of outer boom, telescope and gripper about the elbow along the telescope's "
        "axis at q4 = 0",
    ),
    Parameter(
        "S_SL_normal",
        "kg m",
        None,
        "mass moment of outer boom, telescope and gripper about the elbow normal to the "
        "telescope's axis",
    ),
    Parameter("m_TL", "kg", 0.0, "mass of telescope and gripper"),
    Parameter(
        "S_TL_along",
        "kg m",
        None,
        "mass moment of telescope and gripper along the telescope's axis, from the elbow at q4 = 0",
    ),
)

LAGRANGIAN = (
    *BASE_PARAMETERS,
    Parameter(
        "S_TL_normal",
        "kg m",
        None,
        "mass moment of telescope and gripper about the elbow normal to the telescope's axis",
    ),
)
"""Those of `crane_model.dynamics`: the base set where that moment does not follow from the mass."""
