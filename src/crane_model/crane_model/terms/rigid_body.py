"""Rigid-body terms."""

from functools import lru_cache
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from crane_model.array import Array
from crane_model.base_parameters import (
    AXIS_COSINE,
    BaseSet,
    base_set,
    lagrangian_from_standard,
    standard_from_chain,
)
from crane_model.chain import SerialChain
from crane_model.chain.body_regressor import PER_BODY, fill_regressor
from crane_model.chain.slopes import pull_back as chain_pull_back
from crane_model.dynamics import Geometry, fill_base_regressor, planar_pull_back
from crane_model.errors import ConfigurationError
from crane_model.joint import MachineJoint
from crane_model.machine import Machine
from crane_model.record import Record
from crane_model.terms.gravity_and_load import planar_columns, planar_machine
from crane_model.terms.term import Parameter, Setting, Term


class PlanarRigidBody(Term):
    """M(q) q'' + C(q, q') q' + G(q) of (7), linear in the eight base parameters (8).

    The centre of mass of telescope and gripper lies on the telescope's axis, so that its normal
    moment about the elbow is a3 m_TL and not a parameter of its own.
    """

    type: Literal["planar_rigid_body"] = "planar_rigid_body"
    family = "rigid body"
    has_base_parameters = True
    of_one_instant = True

    def parameters(self, setting: Setting) -> tuple[Parameter, ...]:
        planar_machine(self, setting)
        return BASE_PARAMETERS

    def of_bodies(self, setting: Setting) -> Array | None:
        machine = planar_machine(self, setting)
        lagrangian = lagrangian_from_standard(Geometry.of(machine))
        bodies: Array = lagrangian[: len(BASE_PARAMETERS)] @ standard_from_chain(machine)
        return bodies

    def fill(self, record: Record, setting: Setting, columns: Array) -> None:
        geometry = Geometry.of(planar_machine(self, setting))
        motion = record.position, record.velocity, record.acceleration
        fill_base_regressor(geometry, *motion, planar_columns(setting, record), columns)

    def pull_back(self, record: Record, setting: Setting, weight: Array) -> Array:
        geometry = Geometry.of(planar_machine(self, setting))
        at = planar_columns(setting, record)
        motion = record.position, record.velocity, record.acceleration
        q, v, acceleration = (values[:, at] for values in motion)
        slopes = np.zeros((3, *record.position.shape))
        slopes[:, :, at] = planar_pull_back(geometry, q, v, acceleration, weight[:, at])
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


# The rigid bodies of any serial machine.

_UNITS = {"m": "kg", "mx": "kg m", "my": "kg m", "mz": "kg m"}  # else kg m2
_SPAN_TOLERANCE = 1e-6  # of the norm of a combination, that two sets span the same


class SerialRigidBody(Term):
    """M(q) q'' + C(q, q') q' + G(q) (6) of a serial chain in space, linear in its base parameters.

    Each is a combination of the ten parameters of the bodies (`crane_model.chain`), named after the
    one that its joint shows, for example the inertia about its axis: Izz.boom, or Izz_r.boom where
    others are regrouped with it, which its meaning lists.
    Bodies that are symmetric may have parameters that are `zero`, as mx.telescope. Joints of the
    machine that the model lacks stand still. A crane as of the report has its parameters (8) under
    their names, and S_TL_normal unless that is excluded by mx of its telescope being zero.
    """

    type: Literal["serial_rigid_body"] = "serial_rigid_body"
    family = "rigid body"
    of_one_instant = True

    zero: tuple[str, ...] = ()

    @property
    def zero_moments(self) -> tuple[str, ...]:
        return self.zero

    def parameters(self, setting: Setting) -> tuple[Parameter, ...]:
        return self._bodies(setting).parameters

    def of_bodies(self, setting: Setting) -> Array | None:
        bodies = self._bodies(setting)
        if bodies.turned is None:
            return bodies.base.combination
        turned: Array = np.asarray(np.linalg.solve(bodies.turned, bodies.base.combination), float)
        return turned

    def fill(self, record: Record, setting: Setting, columns: Array) -> None:
        bodies = self._bodies(setting)
        motion = self._motion(record, setting)
        if bodies.turned is None:
            fill_regressor(*motion.chain, bodies.base.leading, *motion.samples, columns)
            return
        regressor = np.zeros(columns.shape)
        fill_regressor(*motion.chain, bodies.base.leading, *motion.samples, regressor)
        columns[:] = regressor @ bodies.turned

    def pull_back(self, record: Record, setting: Setting, weight: Array) -> Array:
        bodies = self._bodies(setting)
        motion = self._motion(record, setting)
        if bodies.turned is not None:
            weight = weight @ bodies.turned.T
        slopes: Array = chain_pull_back(*motion.chain, bodies.base.leading, *motion.samples, weight)
        return slopes[:, :, : record.position.shape[1]]

    def _motion(self, record: Record, setting: Setting) -> "_Motion":
        machine = setting.machine
        assert machine is not None  # _bodies() refuses such a model
        names = [joint for joint in machine.joint_names if joint in setting.units]
        places = {joint: record.column(joint) for joint in names}
        still = record.position.shape[1]  # a column of zeros beside those of the record
        q, v, a = record.position, record.velocity, record.acceleration
        if len(names) < len(machine.joint_names):
            q, v, a = (np.pad(values, ((0, 0), (0, 1))) for values in (q, v, a))
        at = np.array([places.get(joint, still) for joint in machine.joint_names])
        leader = at[machine.chain.leader]
        rows = np.where(leader == still, -1, leader)
        return _Motion((machine.chain._replace(leader=leader), rows), (q, v, a))

    def _bodies(self, setting: Setting) -> "_Bodies":
        machine = setting.machine
        if machine is None:
            raise ConfigurationError(f"term '{self.type}': needs a machine; the model has none")
        joints = tuple(joint for joint in machine.joint_names if joint in setting.units)
        try:
            return _bodies(machine, joints, self.zero)
        except ConfigurationError as error:
            raise ConfigurationError(f"term '{self.type}': {error}") from None


class _Motion(NamedTuple):
    """A record as the chain takes it."""

    chain: tuple[SerialChain, NDArray[np.int64]]  # its joints lead from the record's columns, rows
    samples: tuple[Array, Array, Array]  # q, q', q''


class _Bodies(NamedTuple):
    base: BaseSet
    parameters: tuple[Parameter, ...]
    turned: Array | None  # (r, r): columns of other combinations from those of the base set


@lru_cache(maxsize=64)
def _bodies(machine: Machine, joints: tuple[str, ...], zero: tuple[str, ...]) -> _Bodies:
    if not joints:
        raise ConfigurationError(
            f"the model has no joint of {machine.name}, which has {', '.join(machine.joint_names)}"
        )
    base = base_set(machine, joints, zero)
    if unknown := set(zero) - set(base.names):
        raise ConfigurationError(
            f"zero: no parameter '{min(unknown)}'; there are {', '.join(PER_BODY)} of each of "
            f"{', '.join(joint.name for joint in machine.joints)}"
        )
    if (turned := _in_the_plane(machine, joints, base)) is not None:
        return _Bodies(base, LAGRANGIAN[: len(base.leading)], turned)
    return _Bodies(
        base, tuple(_parameter(machine, base, k) for k in range(len(base.leading))), None
    )


def _parameter(machine: Machine, base: BaseSet, k: int) -> Parameter:
    kind, _, joint = base.names[base.leading[k]].partition(".")
    parts = base.combination[k]
    positive = (parts >= 0.0).all() and kind in ("m", "Ixx", "Iyy", "Izz")
    positive = positive and all(
        base.names[i].startswith(("m.", "Ixx", "Iyy", "Izz")) for i in np.flatnonzero(parts)
    )
    symbol = kind if np.count_nonzero(parts) == 1 else f"{kind}_r"
    unit = _UNITS.get(kind, "kg m2")
    moved = next(moved for moved in machine.joints if moved.name == joint)
    told = base.told(k)
    meaning = f"{_meaning(moved, kind)}{'' if told == f'{kind}.{joint}' else f', {told}'}"
    return Parameter(f"{symbol}.{joint}", unit, 0.0 if positive else None, meaning)


def _meaning(joint: MachineJoint, kind: str) -> str:
    """One of the ten parameters of a body in words."""
    if kind == "m":
        return f"mass that {joint.name} moves"
    axes = kind.removeprefix("m").removeprefix("I")
    if kind[0] == "m":
        return f"mass moment along {axes} of {joint.name}"
    if axes[0] != axes[1]:
        return f"product of inertia {axes} of {joint.name}"
    if abs(joint.direction["xyz".index(axes[0])]) > AXIS_COSINE:
        return f"inertia about the axis of {joint.name}"
    return f"inertia about {axes[0]} of {joint.name}"


def _in_the_plane(machine: Machine, joints: tuple[str, ...], base: BaseSet) -> Array | None:
    """(r, r) from columns of the base set to those of (8), where they span the same; else None."""
    crane = machine.planar
    if crane is None or joints != crane.joints:
        return None
    known = lagrangian_from_standard(Geometry.of(machine)) @ standard_from_chain(machine)
    kept = np.any(base.combination != 0.0, axis=0)
    planar = (known * kept)[: len(base.leading)]
    turned: Array = np.linalg.lstsq(planar.T, base.combination.T, rcond=None)[0].T
    rest = base.combination - turned @ planar
    if np.linalg.norm(rest) > _SPAN_TOLERANCE * np.linalg.norm(base.combination):
        return None
    return turned
