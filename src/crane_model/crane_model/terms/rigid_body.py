"""Rigid-body terms."""

from collections.abc import Mapping
from typing import ClassVar, Literal

import numpy as np

from crane_model.dynamics import Geometry, fill_base_regressor
from crane_model.errors import ConfigurationError
from crane_model.machine import JOINT_UNITS, PLANAR_JOINTS
from crane_model.record import Record
from crane_model.terms.term import Family, Parameter, Setting, Term


class PlanarRigidBody(Term):
    """M(q) q'' + C(q, q') q' + G(q) of (7), linear in the eight base parameters (8).

    The centre of mass of telescope and gripper lies on the telescope's axis, so that its normal
    moment about the elbow is a3 m_TL and not a parameter of its own.
    """

    type: Literal["planar_rigid_body"] = "planar_rigid_body"
    family: ClassVar[Family] = "rigid body"

    def parameters(self, setting: Setting) -> tuple[Parameter, ...]:
        """The base set of the suite, each named as the combination that it is."""
        needed = {joint: JOINT_UNITS[joint] for joint in PLANAR_JOINTS}
        if setting.machine is None or list(setting.units.items()) != list(needed.items()):
            raise ConfigurationError(
                f"term '{self.type}': needs a machine and the joints {_listed(needed)} in this "
                f"order, got {_listed(setting.units)}"
                + ("" if setting.machine else " and no machine")
            )
        return BASE_PARAMETERS

    def fill(self, record: Record, setting: Setting, columns: np.ndarray) -> None:
        """(n, 3, 8)."""
        assert setting.machine is not None  # parameters() refuses such a model
        geometry = Geometry.of(setting.machine)
        motion = record.position, record.velocity, record.acceleration
        fill_base_regressor(geometry, *motion, columns)


def _listed(units: Mapping[str, str]) -> str:
    return ", ".join(f"{joint} [{unit}]" for joint, unit in units.items())


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
