"""Elastic effects: hoses and booms that spring back, a boom that bends, a load that swings."""

import math
from typing import Literal, NamedTuple

import numpy as np
from numba import njit
from pydantic import Field

from crane_model.array import Array, Flags
from crane_model.machine import Machine
from crane_model.record import Record
from crane_model.terms.gravity_and_load import AxisReach, planar_columns, planar_machine, plane_of
from crane_model.terms.joint_term import JointTerm, MemoryTerm, OneJointTerm
from crane_model.terms.term import Effect, Parameter, Setting, Shape

# A damped oscillator carried along by a motion: what swings on a boom, or in it.
#
# e'' + 2 damping w e' + w^2 e = -a, with e the displacement against the carrier, whose acceleration
# is a, and w = 2 pi frequency. Its states are e and e'.


@njit(cache=True)
def swung_once(
    e: float, rate: float, push: float, step: float, frequency: float, damping: float
) -> tuple[float, float]:
    """e and e' after a step [s], exact for an acceleration `push` that is constant."""
    w = 2.0 * math.pi * frequency
    ringing = w * math.sqrt(1.0 - damping**2)
    middle = -push / w**2
    x = e - middle
    fading = math.exp(-damping * w * step)
    cos, sin = math.cos(ringing * step), math.sin(ringing * step) / ringing
    return (
        middle + fading * (x * cos + (rate + damping * w * x) * sin),
        fading * (rate * cos - (damping * w * rate + w**2 * x) * sin),
    )


@njit(cache=True)
def swung(states: Array, push: Array, step: Array, frequency: float, damping: float) -> Array:
    """States (n, 2) after steps (n,) [s] with constant accelerations `push` (n,)."""
    out = np.empty_like(states)
    for n in range(len(states)):
        out[n, 0], out[n, 1] = swung_once(
            states[n, 0], states[n, 1], push[n], step[n], frequency, damping
        )
    return out


@njit(cache=True)
def swung_along(
    velocity: Array, time: Array, first: Flags, frequency: float, damping: float
) -> Array:
    """States (n, 2) on a carrier of velocity (n,); each run begins at rest on it."""
    states = np.zeros((len(velocity), 2))
    for k in range(1, len(velocity)):
        if not first[k]:
            step = time[k] - time[k - 1]
            push = (velocity[k] - velocity[k - 1]) / step
            states[k, 0], states[k, 1] = swung_once(
                states[k - 1, 0], states[k - 1, 1], push, step, frequency, damping
            )
    return states


def relative_acceleration(states: Array, carrier: Array, frequency: float, damping: float) -> Array:
    """e'' (n,), given the states (n, 2) and the acceleration (n,) of the carrier."""
    w = 2.0 * math.pi * frequency
    return -carrier - 2.0 * damping * w * states[:, 1] - w**2 * states[:, 0]


# A point mass at the boom tip (2) that a spring carries: it bends the crane at one joint.
#
# With the tip at r(q), bending by e moves it to r(q + c e), c the coordinate of the bent joint. By
# virtual work a mass of 1 kg asks of joint j the force phi_j = dr/dq_j (r'' + g); the spring, whose
# force kappa e + delta e' is all that holds the mass at c, makes the balance phi_c = -kappa e -
# delta e' the equation of e. What bending changes on all joints is phi(bent) - phi(straight).

SAG_PASSES = 20  # in which a mass sags to where its spring holds it; each halves the error at least
MAX_DAMPING_RATIO = (
    0.95  # of critical damping, where a pose leaves less inertia than the damper is made for
)


Gradient = tuple[float, float, float]  # d/dq of inner boom, outer boom and telescope


class Bend(NamedTuple):
    """Flexible part, for compiled code: the tip's geometry (2), then spring and damper of 1 kg."""

    theta_2_0: float
    inner_boom_length: float
    telescope_offset: float
    telescope_length: float
    gravity: float
    joint: int  # inner boom, outer boom or telescope: 0, 1, 2
    inertia: float  # of 1 kg about the joint in the middle of all ranges, kg m2 (telescope: kg)
    stiffness: float  # N m/rad (telescope: N/m)
    damper: float

    @classmethod
    def of(cls, machine: Machine, joint: str, frequency: float, damping: float) -> "Bend":
        """A spring of this `frequency` [Hz] and share of critical `damping` at mid-range."""
        dh = machine.as_planar()
        middle = machine.ranges(dh.joints).middle
        geometry = (
            *(dh.theta_2_0, dh.inner_boom_length, dh.telescope_offset, dh.telescope_length),
            machine.gravity,
        )
        i = dh.joints.index(joint)
        out, down = _gradients(cls(*geometry, i, 1.0, 0.0, 0.0), middle)
        inertia, omega = out[i] ** 2 + down[i] ** 2, 2.0 * math.pi * frequency
        return cls(*geometry, i, inertia, inertia * omega**2, 2.0 * damping * omega * inertia)


@njit(cache=True)
def _gradients(bend: Bend, q: Array) -> tuple[Gradient, Gradient]:
    """d/dq of the tip's distance from the slew axis and of its height."""
    phi, psi = q[0] + bend.theta_2_0, q[0] + q[1]
    along, normal = bend.telescope_length + q[2], bend.telescope_offset
    x = along * math.cos(psi) - normal * math.sin(psi)
    z = along * math.sin(psi) + normal * math.cos(psi)
    elbow_x = bend.inner_boom_length * math.cos(phi)
    elbow_z = bend.inner_boom_length * math.sin(phi)
    return (-elbow_z - z, -z, math.cos(psi)), (elbow_x + x, x, math.sin(psi))


@njit(cache=True)
def _forces(
    bend: Bend, q: Array, v: Array, a: Array, e: float, rate: float, out: Array
) -> tuple[Gradient, Gradient]:
    """Write phi (3,) of the bent crane at e'' = 0; its `_gradients`.

    `q` and `v` (3,) are bent as well.
    """
    i = bend.joint
    q[i] += e
    v[i] += rate
    outward, upward = _gradients(bend, q)
    phi_rate, psi_rate, slide = v[0], v[0] + v[1], v[2]
    cos_psi, sin_psi = outward[2], upward[2]
    # r'' at q'' = 0: towards joint 2, towards the elbow, and Coriolis along the turn
    a_x = -(upward[0] - upward[1]) * phi_rate**2 - upward[1] * psi_rate**2
    a_z = (outward[0] - outward[1]) * phi_rate**2 + outward[1] * psi_rate**2 + bend.gravity
    a_x -= 2.0 * slide * psi_rate * sin_psi
    a_z += 2.0 * slide * psi_rate * cos_psi
    for j in range(3):
        a_x += outward[j] * a[j]
        a_z += upward[j] * a[j]
    for j in range(3):
        out[j] = outward[j] * a_x + upward[j] * a_z
    return outward, upward


@njit(cache=True)
def sagging(bend: Bend, q: Array) -> Array:
    """States (n, 2), e and e', where the spring holds the mass at rest at n poses (n, 3)."""
    states, force, still = np.zeros((len(q), 2)), np.empty(3), np.zeros(3)
    for n in range(len(q)):
        for _ in range(SAG_PASSES):
            _forces(bend, q[n].copy(), still.copy(), still, states[n, 0], 0.0, force)
            states[n, 0] = -force[bend.joint] / bend.stiffness
    return states


@njit(cache=True)
def _copy(values: Array, out: Array) -> None:
    for j in range(3):
        out[j] = values[j]


@njit(cache=True)
def _bent(
    bend: Bend, q: Array, v: Array, push: Array, step: float,
    e: float, rate: float, force: Array,
) -> tuple[float, float]:  # fmt: skip
    """e and e' after a step [s] of constant `push` (3,); q, v half-way, bent as well."""
    outward, upward = _forces(bend, q, v, push, e + 0.5 * step * rate, rate, force)
    inertia = outward[bend.joint] ** 2 + upward[bend.joint] ** 2
    omega = math.sqrt(bend.stiffness / inertia)
    damping = min(bend.damper / (2.0 * omega * inertia), MAX_DAMPING_RATIO)
    carried = force[bend.joint] / inertia
    return swung_once(e, rate, carried, step, omega / (2.0 * math.pi), damping)


@njit(cache=True)
def bent(bend: Bend, states: Array, q: Array, v: Array, push: Array, step: Array) -> Array:
    """States (n, 2) after steps (n,) [s] of constant accelerations `push` (n, 3); q, v half-way."""
    out, force, place, speed = np.empty_like(states), np.empty(3), np.empty(3), np.empty(3)
    for n in range(len(states)):
        e, rate = states[n]
        _copy(q[n], place)
        _copy(v[n], speed)
        out[n] = _bent(bend, place, speed, push[n], step[n], e, rate, force)
    return out


@njit(cache=True)
def bent_along(bend: Bend, q: Array, v: Array, time: Array, first: Flags) -> Array:
    """States (n, 2) along positions and velocities (n, 3); each run begins sagging at rest."""
    states, force = np.empty((len(q), 2)), np.empty(3)
    push, middle, speed = np.empty(3), np.empty(3), np.empty(3)
    for k in range(len(q)):
        if first[k]:
            states[k] = sagging(bend, q[k : k + 1])[0]
            continue
        step = time[k] - time[k - 1]
        for j in range(3):
            push[j] = (v[k, j] - v[k - 1, j]) / step
            middle[j], speed[j] = (q[k, j] + q[k - 1, j]) / 2.0, (v[k, j] + v[k - 1, j]) / 2.0
        e, rate = states[k - 1]
        states[k] = _bent(bend, middle, speed, push, step, e, rate, force)
    return states


@njit(cache=True)
def bending_forces(bend: Bend, states: Array, q: Array, v: Array, a: Array) -> Array:
    """phi(bent) - phi(straight) on inner boom, outer boom and telescope, (n, 3), of 1 kg."""
    out, straight, i = np.empty((len(q), 3)), np.empty(3), bend.joint
    place, speed = np.empty(3), np.empty(3)
    for n in range(len(q)):
        e, rate = states[n]
        _copy(q[n], place)
        _copy(v[n], speed)
        _forces(bend, place, speed, a[n], 0.0, 0.0, straight)  # which bends by nothing
        outward, upward = _forces(bend, place, speed, a[n], e, rate, out[n])
        spring = bend.stiffness * e + bend.damper * rate
        swing = -(spring + out[n, i]) / (outward[i] ** 2 + upward[i] ** 2)  # e''
        for j in range(3):
            out[n, j] += (outward[j] * outward[i] + upward[j] * upward[i]) * swing - straight[j]
    return out


# Elastic parts: hoses at a joint, and the boom that it moves.


class HoseStiffness(JointTerm):
    """k q: hoses and cables that bend with the joint; where they are relaxed, k q_0, is constant.

    That constant is the asymmetry of Coulomb friction (13), which a model holds beside it.
    """

    type: Literal["hose_stiffness"] = "hose_stiffness"
    family = "elasticity"
    effect = Effect(
        "hose stiffness",
        "force in proportion to the position, whatever load and speed",
        ("pressure_offset", "encoder_offset"),
        "poses at rest over the whole range, with hoses connected and disconnected",
        follows=("position",),
    )
    symbol = Parameter("k_hose", "{force}/{coordinate}", 0.0, "stiffness of hoses and cables")

    def column(self, record: Record, j: int) -> Array:
        return record.position[:, j]


class BoomFlexibility(OneJointTerm, MemoryTerm):
    """J/I (phi(q + e) - phi(q)): a boom that bends by e, and deflects all that hangs behind it.

    phi = J_tip^T (r'' + g) is what a mass of 1 kg at the boom tip (2) asks of the joints, I its
    inertia about the joint in the middle of all ranges. There, the spring that bends has this
    frequency; phi_joint(q + e) = -kappa e - delta e' makes e follow the load, which sags, and ring.
    A model without the planar crane knows no weight and no other joint: J e'' with
    e'' + 2 damping w e' + w^2 e = -q'', w = 2 pi frequency.
    """

    type: Literal["boom_flexibility"] = "boom_flexibility"
    family = "elasticity"
    effect = Effect(
        "boom flexibility",
        "sagging under the load and ringing after jerks, on every joint that the bend moves",
        ("time_skew", "swinging_load", "actuator_inertia"),
        "a fast stop at several extensions and payloads, recorded until the ringing has died out",
        follows=("acceleration",),
    )
    shapes = {
        "frequency": Shape(0.7, 12.0, "Hz", 16, "natural frequency"),
        "damping": Shape(0.03, 0.3, "1", 2, "share of critical damping"),
    }

    symbols = (Parameter("J_flexible", "{inertia}", 0.0, "inertia that takes part in the bending"),)

    frequency: float = Field(gt=0)
    damping: float = Field(gt=0, lt=1)

    def start(self, record: Record, setting: Setting) -> Array:
        bend = self._bend(setting)
        if bend is None:
            return np.zeros((len(record), 2))
        return sagging(bend, record.position[:, planar_columns(setting, record)])

    def advance(self, states: Array, before: Record, after: Record, setting: Setting) -> Array:
        bend, step = self._bend(setting), after.time - before.time
        push = (after.velocity - before.velocity) / step[:, np.newaxis]
        if bend is None:
            acceleration = push[:, before.column(self.joint)]
            return swung(states, acceleration, step, self.frequency, self.damping)
        at = planar_columns(setting, before)
        q, v = (
            (begin[:, at] + end[:, at]) / 2.0
            for begin, end in ((before.position, after.position), (before.velocity, after.velocity))
        )
        return bent(bend, states, q, v, push[:, at], step)

    def trace(self, record: Record, setting: Setting) -> Array:
        bend, first = self._bend(setting), record.first_of_run
        if bend is None:
            v = np.ascontiguousarray(record.velocity[:, record.column(self.joint)])
            return swung_along(v, record.time, first, self.frequency, self.damping)
        at = planar_columns(setting, record)
        return bent_along(bend, record.position[:, at], record.velocity[:, at], record.time, first)

    def fill(self, record: Record, setting: Setting, columns: Array) -> None:
        bend = self._bend(setting)
        if bend is None:
            super().fill(record, setting, columns)
            return
        at, states = planar_columns(setting, record), self.states(record, setting)
        motion = record.position[:, at], record.velocity[:, at], record.acceleration[:, at]
        columns[:, at, 0] = bending_forces(bend, states, *motion) / bend.inertia

    def joint_columns(self, record: Record, setting: Setting, j: int) -> Array:
        states = self.states(record, setting)
        carrier = record.acceleration[:, j]
        return relative_acceleration(states, carrier, self.frequency, self.damping)

    def _bend(self, setting: Setting) -> Bend | None:
        """How the planar crane bends; None in a model without it, and for the slew."""
        if self.joint not in plane_of(setting):
            return None
        return Bend.of(planar_machine(self, setting), self.joint, self.frequency, self.damping)


# A load that hangs from the boom tip.


class SwingingLoad(MemoryTerm):
    """m J_x^T e'' with e'' + 2 damping w e' + w^2 e = -a_x, w = 2 pi frequency = sqrt(g/l).

    A pendulum of small angles under the boom tip (2), which accelerates by a_x away from the
    pillar; e is how far the load swings. Hanging still, e'' = 0, it is part of the mass of
    telescope and gripper (8). Swinging across the plane of the booms does not load their joints.
    """

    type: Literal["swinging_load"] = "swinging_load"
    family = "gravity and load"
    effect = Effect(
        "swinging load",
        "a narrow band near sqrt(g/l)/2 pi on all joints that goes on when the crane stands",
        ("boom_flexibility",),
        "a recording at rest after a fast stop, with the load and without it",
        follows=("acceleration",),
    )
    shapes = {
        "frequency": Shape(0.25, 1.2, "Hz", 14, "sqrt(g/l)/2 pi of the pendulum"),
        "damping": Shape(0.01, 0.1, "1", 2, "share of critical damping"),
    }

    frequency: float = Field(gt=0)
    damping: float = Field(gt=0, lt=1)

    def parameters(self, setting: Setting) -> tuple[Parameter, ...]:
        planar_machine(self, setting)
        return (Parameter("m_swinging", "kg", 0.0, "mass that swings under the boom tip"),)

    def start(self, record: Record, setting: Setting) -> Array:
        return np.zeros((len(record), 2))

    def advance(self, states: Array, before: Record, after: Record, setting: Setting) -> Array:
        """Exact for a step in which the tip accelerates evenly."""
        step = after.time - before.time
        push = (self._tip_velocity(after, setting) - self._tip_velocity(before, setting)) / step
        return swung(states, push, step, self.frequency, self.damping)

    def trace(self, record: Record, setting: Setting) -> Array:
        velocity, first = self._tip_velocity(record, setting), record.first_of_run
        return swung_along(velocity, record.time, first, self.frequency, self.damping)

    def fill(self, record: Record, setting: Setting, columns: Array) -> None:
        tip, at = self._tip(record, setting), planar_columns(setting, record)
        carrier = np.einsum("nj,nj->n", tip.gradient, record.acceleration[:, at]) + tip.bias
        states = self.states(record, setting)
        swing = relative_acceleration(states, carrier, self.frequency, self.damping)
        columns[:, at, 0] = swing[:, np.newaxis] * tip.gradient

    def _tip(self, record: Record, setting: Setting) -> AxisReach:
        machine = planar_machine(self, setting)
        return AxisReach.of(machine, machine.as_planar().telescope_length, record)

    def _tip_velocity(self, record: Record, setting: Setting) -> Array:
        velocity = record.velocity[:, planar_columns(setting, record)]
        along: Array = np.einsum("nj,nj->n", self._tip(record, setting).gradient, velocity)
        return along
