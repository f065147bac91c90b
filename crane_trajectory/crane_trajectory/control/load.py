"""The load of each cylinder: that of the identified model (16), and that at the tip."""

import math
from typing import NamedTuple

import numpy as np

from crane_model.chain.dynamics import inverse_dynamics, tip_bodies
from crane_model.errors import DataError
from crane_model.machine import Machine
from crane_model.model_file import Model
from crane_model.motion_columns import smooth_forces, table
from crane_model.record import Record
from crane_model.terms import Term
from crane_model.terms.term import Setting

# The load of each cylinder along a reference: the identified model (16), made smooth.

REVERSAL_SPEED = 0.008  # rad/s or m/s; for slow valves sgn(q') of (13) is tanh(q' / this)


class ReferenceLoad:
    """Generalized forces that the reference needs, of all joints of a machine.

    Friction, as far as it follows the motion of the instant, and the terms of rigid bodies, gravity
    and loads count; what else the model has follows no reference. A joint that the model lacks has
    no load. `at_tip` [kg] hangs at the tip beside what the model has there.
    """

    def __init__(self, model: Model, machine: Machine):
        self._columns = [machine.joint_names.index(joint) for joint in model.joints]
        self._model, self._count = model, len(machine.joint_names)
        self._bodies: list[tuple[Term, np.ndarray, np.ndarray]] = []
        self._theta, self._time = np.zeros(len(model.theta)), np.zeros(1)
        one = np.zeros((1, len(model.joints)))
        rest = Record(model.joints, self._time, one, one, one)
        for term in model.terms:
            part = model.part(term)
            if term.motion_columns(model.setting):
                if term.is_friction() or term.has_weight():
                    self._theta[part] = model.theta[part]
            elif term.has_weight() and _follows(term, rest, model.setting):
                values = model.theta[part]
                self._bodies.append((term, np.zeros((*one.shape, len(values))), values))
        self.at_tip = 0.0
        self._chain, self._one_kilogram = machine.chain, tip_bodies(machine.chain)[0]
        self._table = table(model.motion_columns, model.joints)

    def __call__(
        self, position: np.ndarray, velocity: np.ndarray, acceleration: np.ndarray
    ) -> np.ndarray:
        """(j,) N m, N at a point (j,) of the reference."""
        q, v, a = (
            np.take(each, self._columns)[None] for each in (position, velocity, acceleration)
        )
        tau = np.empty_like(v)
        smooth_forces(self._table, self._theta, v, a, REVERSAL_SPEED, tau)
        record = Record(self._model.joints, self._time, q, v, a)
        for term, columns, values in self._bodies:
            columns[:] = 0.0
            term.fill(record, self._model.setting, columns)
            tau += columns @ values
        if self.at_tip:
            motion = position[None], velocity[None], acceleration[None]
            one = inverse_dynamics(self._chain, self._one_kilogram, *motion)
            tau += self.at_tip * one[:, self._columns]
        load = np.zeros(self._count)
        load[self._columns] = tau[0]
        return load


def _follows(term: Term, record: Record, setting: Setting) -> bool:
    """Whether a term needs no more than the reference: no memory and no other signal."""
    if term.start(record, setting).shape[1]:
        return False
    try:
        term.columns(record, setting)
    except DataError:
        return False
    return True


# How far a load at the tip, as a scale tells it, is believed: what the crane is led with.
#
# A load m that is told with a standard deviation s counts as
#
#     m m^2 / (m^2 + s^2)
#
# so that one which may as well be nothing counts as nothing. One that is old, is no number, comes
# of a scale that is degraded, or is heavier than any that is allowed counts as nothing, too. The
# crane is led with a mass that goes there at a bounded rate: whatever is told, no command jumps.

RATE = 20.0  # kg/s
OLDEST = 1.0  # s between the load that is told and the reading that it is used with
LONGEST = 0.05  # s between two readings; a longer gap counts as this
BELIEVED = ("GOOD", "AT_REST", "UNOBSERVABLE")
"""Conditions of a scale that has its readings. Where a pose does not permit weighing, it keeps the
load, with a standard deviation that grows."""


class ToldLoad(NamedTuple):
    """What a scale tells."""

    time: float  # s, of the clock of the readings
    mass: float  # kg
    deviation: float  # kg, standard deviation
    condition: str


class FedLoad:
    """The mass that the crane is led with; `heaviest` [kg] is the largest that is believed."""

    def __init__(self, heaviest: float):
        self._heaviest = heaviest
        self._told: ToldLoad | None = None
        self._time = math.inf
        self.mass = 0.0  # kg

    def tell(self, told: ToldLoad) -> None:
        """The newest."""
        self._told = told

    def at(self, time: float) -> float:
        """The mass [kg] at a time [s], which moves towards what is believed then."""
        step = RATE * min(max(time - self._time, 0.0), LONGEST)
        self._time = time
        away = self.believed(time) - self.mass
        self.mass += min(max(away, -step), step)
        return self.mass

    def believed(self, time: float) -> float:
        """What is told [kg], as far as it counts at a time [s]."""
        told = self._told
        if told is None or told.condition not in BELIEVED:
            return 0.0
        if not abs(time - told.time) <= OLDEST:
            return 0.0
        if not (0.0 < told.mass <= self._heaviest and 0.0 <= told.deviation < math.inf):
            return 0.0
        share = told.mass / math.hypot(told.mass, told.deviation)
        return told.mass * share**2
