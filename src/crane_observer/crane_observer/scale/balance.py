"""The force balance with a load at the tip: what model and load ask of the drives.

    tau = tau_0(q, q', q'') + m h_m(q, q', q'') + s h_s(q, q', q'')

tau_0 is the model (16), h_m what 1 kg at the tip asks, and h_s what 1 kg m about the tip does: a
load m whose centre lies c beyond the tip, along the line from the last joint, has s = m c.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from crane_model.array import Array
from crane_model.chain.dynamics import inverse_dynamics, tip_bodies
from crane_model.cylinders import ChamberForces
from crane_model.errors import ConfigurationError
from crane_model.machine import Machine
from crane_model.model_file import Model
from crane_model.record import Record

NUDGE = 1e-4  # rad or m, for slopes
FASTER = 1e-2  # share of the velocity, for what grows with it


class MeanMotion(NamedTuple):
    """Means over a window of j joints, weighted as `crane_observer.scale.scale` does."""

    position: Array  # (j,) rad, m
    velocity: Array  # (j,)
    acceleration: Array  # (j,)
    chamber_a: Array  # (j,) Pa; NaN where nothing was measured
    chamber_b: Array  # (j,)


class TipBalance(NamedTuple):
    """About one motion of j joints [N m, N]; see the equation above."""

    force: Array  # (j,) of the drives, by pressures
    asked: Array  # (j,) tau_0, without dry friction
    up: Array  # (j,) dry friction where the joint moves in its positive direction
    down: Array  # (j,) where it moves in the other
    viscous: Array  # (j,) the part that grows with the velocity
    inertial: Array  # (j,) the part that accelerates
    mass: Array  # (j,) h_m [N m/kg, N/kg]
    moment: Array  # (j,) h_s [1/kg m of these]
    by_pressure: Array  # (j, j) for 1 Pa more in chamber A of each cylinder


@dataclass(frozen=True)
class TipMechanics:
    """A model with values, and bodies of 1 kg and of 1 kg m at the tip of its machine."""

    model: Model
    machine: Machine
    columns: Array  # (j,) where the joints of the model stand among those of the machine
    bodies: Array  # (2, m, 10) as `crane_model.chain` has bodies
    drives: ChamberForces

    @classmethod
    def of(cls, model: Model) -> "TipMechanics":
        """`ConfigurationError` names what the model lacks."""
        machine = model.machine
        if machine is None:
            raise ConfigurationError(
                f"model '{model.name}': no machine in it, which says where the tip is; identify it "
                "with the machine's file"
            )
        _ = model.theta  # or the error that names the remedy
        without = [joint for joint in model.joints if joint not in machine.cylinders]
        if without:
            raise ConfigurationError(
                f"model '{model.name}': {', '.join(without)} without chambers; a load is weighed "
                "by the pressures of hydraulic actuators"
            )
        columns = np.array([machine.index(joint) for joint in model.joints])
        drives = ChamberForces(machine, model.joints)
        return cls(model, machine, columns, tip_bodies(machine.chain), drives)

    def balance(self, motion: MeanMotion) -> TipBalance:
        """`RangeError` where a linkage cannot be assembled."""
        j = len(self.model.joints)
        q, v, a, p_a, p_b = motion
        known = np.isfinite(p_a) & np.isfinite(p_b)
        p_a, p_b = np.where(known, p_a, 0.0), np.where(known, p_b, 0.0)
        force = self.drives(q, np.concatenate([p_a, p_b]))
        by_pressure = np.stack([self.drives(q, row) for row in np.eye(2 * j)[:j]], axis=1)
        lost = (by_pressure[:, ~known] != 0.0).any(axis=1)
        asked, slower, resting, up, down = self._model_forces(motion, force, p_a, p_b)
        carried = np.stack([self._carried(body, q, v, a) for body in self.bodies])
        return TipBalance(
            force=np.where(lost, np.nan, force),
            asked=asked,
            up=up - asked,
            down=down - asked,
            viscous=(asked - slower) / FASTER,
            inertial=asked - resting,
            mass=carried[0],
            moment=carried[1],
            by_pressure=by_pressure,
        )

    def slopes(self, motion: MeanMotion, load: float) -> Array:
        """(j, j) of force less what is asked with a load [kg], row by joint, against positions."""

        def miss(q: Array) -> Array:
            one = self.balance(motion._replace(position=q))
            return one.force - one.asked - load * one.mass

        here, q = miss(motion.position), motion.position
        steps = NUDGE * np.eye(len(q))
        return np.stack([(miss(q + step) - here) / NUDGE for step in steps], axis=1)

    def _model_forces(self, motion: MeanMotion, force: Array, p_a: Array, p_b: Array) -> Array:
        """(5, j): without dry friction; the same slower; without acceleration; moving up; down."""
        cases = np.ones((5, 1))
        velocity = cases * motion.velocity
        velocity[1] *= 1.0 - FASTER
        acceleration = cases * motion.acceleration
        acceleration[2] = 0.0
        direction = np.zeros_like(velocity)
        direction[3], direction[4] = 1.0, -1.0
        rows = np.arange(5.0)
        record = Record(
            joints=self.model.joints,
            time=rows,
            position=cases * motion.position,
            velocity=velocity,
            acceleration=acceleration,
            run=rows,  # nothing is remembered from one row to the next
            force=cases * force,
            pressure_a=cases * p_a,
            pressure_b=cases * p_b,
            direction_known=direction,
        )
        return self.model.predict(record)

    def _carried(self, body: Array, q: Array, v: Array, a: Array) -> Array:
        """(j,) what the body asks, the other joints of the machine at rest."""
        whole = np.zeros((3, 1, len(self.machine.joint_names)))
        whole[:, 0, self.columns] = q, v, a
        return inverse_dynamics(self.machine.chain, body, *whole)[0, self.columns]
