"""A point mass at the boom tip (2) that a spring carries: it bends the crane at one joint.

With the tip at r(q), bending by e moves it to r(q + c e), c the coordinate of the bent joint. By
virtual work a mass of 1 kg asks of joint j the force phi_j = dr/dq_j (r'' + g); the spring, whose
force kappa e + delta e' is all that holds the mass at c, makes the balance phi_c = -kappa e -
delta e' the equation of e. What bending changes on all joints is phi(bent) - phi(straight).
"""

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from crane_model.array import Array, Flags
from crane_model.machine import Machine
from crane_model.terms.oscillator import swung_once

PASSES = 20  # in which a mass sags to where its spring holds it; each halves the error at least
STIFFEST = 0.95  # of critical damping, where a pose leaves less inertia than the damper is made for


Gradient = tuple[float, float, float]  # d/dq of inner boom, outer boom and telescope


class Bend(NamedTuple):
    """What bends, for compiled code: the tip's geometry (2), then spring and damper of 1 kg."""

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
        limits = [machine.limits[name] for name in dh.joints]
        middle = np.array([(row.position_min + row.position_max) / 2.0 for row in limits])
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
        for _ in range(PASSES):
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
    """e and e' after a step [s] of constant acceleration `push` (3,); q, v half-way through it,
    which are bent as well.
    """
    outward, upward = _forces(bend, q, v, push, e + 0.5 * step * rate, rate, force)
    inertia = outward[bend.joint] ** 2 + upward[bend.joint] ** 2
    omega = math.sqrt(bend.stiffness / inertia)
    damping = min(bend.damper / (2.0 * omega * inertia), STIFFEST)
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
