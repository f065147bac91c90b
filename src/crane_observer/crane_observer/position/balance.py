"""The force balance about some poses: what the model, whatever its terms, asks of the drives."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from crane_model.array import Array, Flags
from crane_model.chain.dynamics import inverse_dynamics
from crane_model.hydraulics.stepping import Circuit
from crane_model.machine import Machine
from crane_model.model_file import Model
from crane_model.record import Record
from crane_model.whole_crane import circuit_of, identified
from crane_observer.position.flow import GAIN_DOUBT, GAIN_STAYS, LOAD_DRIFT, STROKE_DOUBT, Served
from crane_observer.position.state import (
    EXTENDING,
    NULL,
    RETRACTING,
    UNEVEN,
    StateLayout,
    Trust,
    flow_share,
    null_deviation,
)

NUDGE = 1e-4  # rad, rad/s, m or m/s, for slopes


class ForceBalance(NamedTuple):
    """At n motions of j joints. Forces are generalized, [N m, N]."""

    smooth: Array  # (n, j) what the model asks without dry friction
    dry: Array  # (n, j) dry friction, to be taken with the sign of the motion
    viscous: Array  # (n, j) what grows with the joint's own velocity, at this velocity
    mass: Array  # (n, j, j) the mass matrix
    load: Array  # (n, j) what a mass of 1 kg at the tip asks
    slope: Array  # (n, j, j) of the smooth force, row by joint, against each coordinate
    load_slope: Array  # (n, j, j) of that of the load
    load_mass: Array  # (n, j, j) what the load adds to the mass matrix, of 1 kg


@dataclass(frozen=True)
class LoadedMechanics:
    """A model with values, and a point mass at the tip of its machine."""

    model: Model
    machine: Machine
    columns: Array  # (j,) where the joints of the model stand among those of the machine
    tip: Array  # (m, 10) the mass of 1 kg, as `crane_model.chain` has bodies

    @classmethod
    def of(cls, model: Model) -> "LoadedMechanics":
        """`ConfigurationError` if the model has no hydraulics or no values."""
        machine, _ = identified(model)
        assert model.theta is not None  # or the error that names the remedy
        x, y, z = machine.chain.tip_translation
        tip = np.zeros((len(machine.joints), 10))
        tip[-1] = (1.0, x, y, z, y * y + z * z, -x * y, x * x + z * z, -x * z, -y * z,
                   x * x + y * y)  # fmt: skip
        columns = np.array([machine.index(joint) for joint in model.joints])
        return cls(model, machine, columns, tip)

    def cylinders(self, q: Array) -> Array:
        """(n, j) coordinates to (n, j, 3): length, lever arm and its derivative; NaN where a
        linkage cannot be assembled.
        """
        joints = self.model.joints
        parts = [self.machine.cylinder(joint, q[:, j]) for j, joint in enumerate(joints)]
        return np.stack(parts, axis=1)

    def balance(self, q: Array, v: Array, a: Array) -> ForceBalance:
        """About coordinates, velocities and accelerations (n, j) each."""
        n, joints = q.shape
        cases = 3 * joints + 2
        position, velocity = np.tile(q, (cases, 1, 1)), np.tile(v, (cases, 1, 1))
        acceleration, direction = np.tile(a, (cases, 1, 1)), np.zeros((cases, n, joints))
        for j in range(joints):
            position[1 + j, :, j] += NUDGE
            acceleration[1 + joints + j, :, j] += 1.0
            velocity[1 + 2 * joints + j, :, j] += NUDGE
        direction[-1] = 1.0
        flat = (-1, joints)
        motion = position.reshape(flat), velocity.reshape(flat), acceleration.reshape(flat)
        rows = np.arange(cases * n)
        record = Record(
            joints=self.model.joints,
            time=rows.astype(float),
            position=motion[0],
            velocity=motion[1],
            acceleration=motion[2],
            run=rows,  # nothing is remembered from one row to the next
            direction_known=direction.reshape(flat),
        )
        force = self.model.predict(record).reshape(cases, n, joints)
        carried = self._carried(*(one[: (1 + 2 * joints) * n] for one in motion))
        carried = carried.reshape(1 + 2 * joints, n, joints)
        damping = (force[1 + 2 * joints : -1] - force[0]) / NUDGE
        return ForceBalance(
            smooth=force[0],
            dry=np.maximum(force[-1] - force[0], 0.0),
            viscous=np.einsum("jnj->nj", damping) * v,
            mass=(force[1 + joints : 1 + 2 * joints] - force[0]).transpose(1, 2, 0),
            load=carried[0],
            slope=((force[1 : 1 + joints] - force[0]) / NUDGE).transpose(1, 2, 0),
            load_slope=((carried[1 : 1 + joints] - carried[0]) / NUDGE).transpose(1, 2, 0),
            load_mass=(carried[1 + joints :] - carried[0]).transpose(1, 2, 0),
        )

    def _carried(self, q: Array, v: Array, a: Array) -> Array:
        """(n, j) what a mass of 1 kg at the tip asks, the other joints of the machine at rest."""
        whole = np.zeros((3, len(q), len(self.machine.joint_names)))
        whole[:, :, self.columns] = q, v, a
        asked = inverse_dynamics(self.machine.chain, self.tip, *whole)
        return asked[:, self.columns]


# The model as the filter uses it.

STANDING = 0.02  # of the fastest that a joint may move, below which it counts as standing
SMALLEST = 1e-12  # of any unit, where nothing may be 0


@dataclass(frozen=True)
class Known:
    """Of j joints."""

    mechanics: LoadedMechanics
    circuit: Circuit
    layout: StateLayout
    low: Array  # (j,) the ends of each joint
    high: Array  # (j,)
    fastest: Array  # (j,) that each may move
    resolution: Array  # (j,) standard deviation of an encoder
    trust: Trust
    flow: Array  # (j,) share of the deviations of flow that its identification leaves
    null: Array  # (j,) of the stroke, standard deviation of the null of each valve
    assumed: Flags  # (j,) whose valve is not identified

    @classmethod
    def of(cls, model: Model, resolution: Array, trust: Trust | None = None) -> "Known":
        """`ConfigurationError` names what the model lacks."""
        model, assumed = Served.of(model)
        mechanics, circuit = LoadedMechanics.of(model), circuit_of(model)
        limits = [mechanics.machine.limits[joint] for joint in model.joints]
        trust, flow = trust or Trust.of(model), flow_share(model)
        return cls(
            mechanics,
            circuit,
            StateLayout(len(model.joints)),
            np.array([one.position_min for one in limits]),
            np.array([one.position_max for one in limits]),
            np.array([min(-one.velocity_min, one.velocity_max) for one in limits]),
            resolution,
            trust,
            flow,
            # what flow deviates by is mostly noise where it is little
            null_deviation(model, trust.null * flow**2),
            assumed,
        )

    @property
    def spread(self) -> Array:
        """(size,) standard deviations of states of which nothing is known, as `Trust.spread`."""
        found = self.trust.spread(self.layout)
        uneven = UNEVEN * self.trust.transducer / self.circuit.supply_pressure
        for kind in (EXTENDING, RETRACTING):
            gain = found[self.layout.of(kind)] * self.flow
            found[self.layout.of(kind)] = np.hypot(gain, uneven)
        found[self.layout.of(NULL)] = self.null
        for kind in (EXTENDING, RETRACTING):
            found[self.layout.of(kind)][self.assumed] = GAIN_DOUBT
        return found

    @property
    def stay(self) -> Array:
        """(size,) s that errors stay, as `Trust.stay`."""
        found = self.trust.stay(self.layout)
        for kind in (EXTENDING, RETRACTING):
            found[self.layout.of(kind)][self.assumed] = GAIN_STAYS
        return found

    @property
    def load_drift(self) -> float:
        """kg/sqrt(s): where a valve is not identified, no surprise tells that a load has come."""
        return LOAD_DRIFT if self.assumed.any() else self.trust.load_drift

    @property
    def stroke(self) -> Array:
        """(j,) of a window's stroke, standard deviation beside those of gains and nulls."""
        return np.where(self.assumed, STROKE_DOUBT, self.trust.stroke * self.flow)

    @property
    def standing(self) -> Array:
        """(j,) speed below which a joint stands."""
        return STANDING * self.fastest
