"""Hidden loads of the whole crane, and inertia of a drive: what adds to M and the bias of (6)."""

import math

import numpy as np
from numba import njit

from crane_model.linkages import inner_boom, outer_boom
from crane_sim.effects.form import Draw, Form, Magnitude
from crane_sim.effects.working import LOADS, Hidden
from crane_sim.parts.constants import Constants
from crane_sim.parts.rigid_bodies import GRIPPER, INNER_BOOM, OUTER_BOOM, Chain, mass_and_bias
from crane_sim.parts.state import State

BODY_AT_TIP, TILTED, HOSE, ROD, PENDULUM, GUSTS, CENTRIFUGAL = range(LOADS, LOADS + 7)

GUST = ((0.11, 1.0), (0.23, 0.8), (0.41, 0.6), (0.67, 0.5), (1.03, 0.35), (1.57, 0.25))  # Hz, share


@njit(cache=True, error_model="numpy")
def carry(hidden: Hidden, k: int, constants: Constants, state: State) -> None:
    """Fill inertia and bias that effect k adds at this instant."""
    law, value = hidden.law[k], hidden.value[k]
    mass, bias = hidden.mass[k], hidden.bias[k]
    mass[:] = 0.0
    bias[:] = 0.0
    chain, q, v = constants.chain, state.q, state.v
    size = value[0]
    if law == BODY_AT_TIP:
        _add_body(chain, q, v, size, value[1], size * value[2] ** 2, mass, bias)
    elif law == TILTED:
        _add_tilt(chain, q, size, bias)
    elif law == HOSE:
        _add_hose(chain, q, v, size, mass, bias)
    elif law == ROD:
        i = hidden.joint[k]
        lever, slope = _lever_and_slope(constants, i, q)
        mass[i, i] = size * lever * lever
        bias[i] = size * lever * slope * v[i] * v[i]
    elif law == PENDULUM:
        _add_swing(hidden, k, chain, q, bias)
    elif law == CENTRIFUGAL:
        _note_centrifugal(chain, q, v, mass, bias)
    elif law == GUSTS:
        push = 0.0
        for n, (frequency, share) in enumerate(GUST):
            phase = 2.0 * math.pi * ((n + 1.0) * value[1] % 1.0)
            push += share * math.sin(2.0 * math.pi * frequency * hidden.clock[0] + phase)
        r, _ = _gradients(chain, q, chain.telescope_length + q[3])
        for i in range(1, 4):
            bias[i] -= size * push * r[i]
    else:
        raise ValueError("a law of a load has no branch in effects/loads.py: give it one")


@njit(cache=True, error_model="numpy")
def _turned(along: float, normal: float, angle: float) -> tuple[float, float]:
    """Radius and height of a vector given along a direction and normal to it."""
    c, s = math.cos(angle), math.sin(angle)
    return along * c - normal * s, along * s + normal * c


@njit(cache=True, error_model="numpy")
def _add_body(
    chain: Chain, q: np.ndarray, v: np.ndarray, m: float, reach: float, inertia: float,
    mass: np.ndarray, bias: np.ndarray,
) -> None:  # fmt: skip
    """A body of mass m whose centre lies `reach` beyond the boom tip, along the telescope."""
    phi, psi = q[1] + chain.theta_20, q[1] + q[2]
    elbow = chain.inner_boom_length
    along, normal = chain.telescope_length + q[3] + reach, chain.telescope_offset
    x, y = _turned(along, normal, psi)
    r, z = _gradients(chain, q, along)
    phi_rate, psi_rate = v[1], v[1] + v[2]
    a_r = -elbow * math.cos(phi) * phi_rate**2 - x * psi_rate**2
    a_r -= 2.0 * v[3] * psi_rate * math.sin(psi)
    a_z = -elbow * math.sin(phi) * phi_rate**2 - y * psi_rate**2 + chain.gravity
    a_z += 2.0 * v[3] * psi_rate * math.cos(psi)
    for i in range(1, 4):
        bias[i] += m * (r[i] * a_r + z[i] * a_z)
        for j in range(1, 4):
            mass[i, j] += m * (r[i] * r[j] + z[i] * z[j])
    for i in range(1, 3):
        for j in range(1, 3):
            mass[i, j] += inertia
    mass[0, 0] += m * (elbow * math.cos(phi) + x) ** 2


@njit(cache=True, error_model="numpy")
def _gradients(
    chain: Chain, q: np.ndarray, along: float
) -> tuple[tuple[float, float, float, float], tuple[float, float, float, float]]:
    """Of radius and height of a point `along` the telescope from the elbow, to the joints."""
    phi, psi = q[1] + chain.theta_20, q[1] + q[2]
    normal = chain.telescope_offset
    x, y = _turned(along, normal, psi)
    elbow_r, elbow_z = (
        chain.inner_boom_length * math.cos(phi),
        chain.inner_boom_length * math.sin(phi),
    )
    return (0.0, -elbow_z - y, -y, math.cos(psi)), (0.0, elbow_r + x, x, math.sin(psi))


@njit(cache=True, error_model="numpy")
def _add_tilt(chain: Chain, q: np.ndarray, angle: float, bias: np.ndarray) -> None:
    """Gravity of all bodies turned by `angle` in the plane of the booms, less that upright."""
    phi, psi = q[1] + chain.theta_20, q[1] + q[2]
    outward = chain.gravity * math.sin(angle)
    upward = chain.gravity * (math.cos(angle) - 1.0)
    body = chain.bodies[INNER_BOOM]
    r, z = _turned(body.along, body.normal, phi)
    bias[1] += body.mass * (-z * outward + r * upward)
    for index in range(OUTER_BOOM, GRIPPER + 1):
        body = chain.bodies[index]
        slide = 0.0 if index == OUTER_BOOM else 1.0
        along = body.along + slide * (chain.telescope_length + q[3])
        normal = body.normal + slide * chain.telescope_offset
        x, y = _turned(along, normal, psi)
        elbow_r, elbow_z = _turned(chain.inner_boom_length, 0.0, phi)
        bias[1] += body.mass * (-(elbow_z + y) * outward + (elbow_r + x) * upward)
        bias[2] += body.mass * (-y * outward + x * upward)
        bias[3] += body.mass * slide * (math.cos(psi) * outward + math.sin(psi) * upward)


@njit(cache=True, error_model="numpy")
def _add_hose(
    chain: Chain, q: np.ndarray, v: np.ndarray, density: float, mass: np.ndarray, bias: np.ndarray
) -> None:
    """Hose of q4 metres out of a reel at the end of the outer boom, weight and inertia.

    T = density (q4^3/3 psi'^2 + q4 q4'^2)/2, V = density g q4^2/2 sin(psi), by Lagrange (3).
    """
    psi, rate, out = q[1] + q[2], v[1] + v[2], max(q[3], 0.0)
    turning = density * (0.5 * chain.gravity * math.cos(psi) + v[3] * rate) * out * out
    for i in range(1, 3):
        bias[i] += turning
        for j in range(1, 3):
            mass[i, j] += density * out**3 / 3.0
    mass[3, 3] += density * out
    bias[3] += density * (0.5 * v[3] ** 2 - 0.5 * (out * rate) ** 2)
    bias[3] += density * chain.gravity * out * math.sin(psi)


@njit(cache=True, error_model="numpy")
def _note_centrifugal(
    chain: Chain, q: np.ndarray, v: np.ndarray, mass: np.ndarray, bias: np.ndarray
) -> None:
    """What slewing does to the booms. It is part of every machine: noted, not added."""
    rate, gravity = np.zeros(4), np.empty(4)
    mass_and_bias(chain, q, rate, mass, gravity)
    rate[0] = v[0]
    mass_and_bias(chain, q, rate, mass, bias)
    for i in range(4):
        bias[i] -= gravity[i]
    mass[:] = 0.0


@njit(cache=True, error_model="numpy")
def _lever_and_slope(constants: Constants, i: int, q: np.ndarray) -> tuple[float, float]:
    """dx/dq and d2x/dq2 of the cylinder of joint i."""
    c = constants.linkages
    if i == 1:
        _, lever, slope = inner_boom(q[1], c.j1, c.j2, c.angle_0)
        return lever, slope
    if i == 2:
        _, lever, slope = outer_boom(
            q[2], c.gamma_21_0, c.gamma_32, c.s22, c.s23, c.c1, c.c2, c.s31
        )
        return lever, slope
    return 1.0, 0.0


@njit(cache=True, error_model="numpy")
def _add_swing(hidden: Hidden, k: int, chain: Chain, q: np.ndarray, bias: np.ndarray) -> None:
    """Force of the load's motion relative to the tip, as it was in the last step.

    memory: angle and rate of the pendulum, acceleration outward and upward relative to the tip.
    """
    size, memory = hidden.value[k, 0], hidden.memory[k]
    r, z = _gradients(chain, q, chain.telescope_length + q[3])
    for i in range(1, 4):
        bias[i] += size * (r[i] * memory[2] + z[i] * memory[3])


@njit(cache=True, error_model="numpy")
def swing(
    hidden: Hidden, k: int, chain: Chain, q: np.ndarray, change: np.ndarray, step: float
) -> None:
    """A plane pendulum under the tip after a step that changed the velocities by `change` (4,).

    Angles of any size; what the tip's acceleration has from velocities alone is left out, as it is
    far below g.
    """
    value, memory = hidden.value[k], hidden.memory[k]
    length, damping = value[1], value[2]
    r, z = _gradients(chain, q, chain.telescope_length + q[3])
    outward, upward = 0.0, chain.gravity
    for i in range(1, 4):
        outward += r[i] * change[i] / step
        upward += z[i] * change[i] / step
    angle, rate = memory[0], memory[1]
    pull = -(outward * math.cos(angle) + upward * math.sin(angle)) / length
    pull -= 2.0 * damping * math.sqrt(chain.gravity / length) * rate
    rate += step * pull
    memory[0], memory[1] = angle + step * rate, rate
    memory[2] = length * (pull * math.cos(angle) - rate * rate * math.sin(angle))
    memory[3] = length * (pull * math.sin(angle) + rate * rate * math.cos(angle))


FORMS = (
    Form("payload", "body", BODY_AT_TIP, Magnitude("mass", "kg", 8.0, 400.0),
         (Draw("reach", "m", 0.0, 0.3), Draw("gyration", "m", 0.1, 0.3)), ()),
    Form("base_tilt", "exact", TILTED, Magnitude("angle", "rad", 0.02, 0.35), (), (), signed=True),
    Form("hose_mass", "reel", HOSE, Magnitude("density", "kg/m", 2.0, 60.0), (), ()),
    Form("actuator_inertia", "rod", ROD, Magnitude("mass", "kg", 100.0, 20000.0)),
    Form("swinging_load", "pendulum", PENDULUM, Magnitude("mass", "kg", 10.0, 80.0),
         (Draw("length", "m", 0.4, 2.0), Draw("damping", "1", 0.01, 0.05)), ()),
    Form("slew_coupling", "slewing", CENTRIFUGAL, Magnitude("speed", "rad/s", 0.2, 0.38),
         (Draw("frequency", "rad/s", 0.5, 0.9),), ()),
    Form("wind", "gusts", GUSTS, Magnitude("force", "N", 20.0, 2000.0),
         (Draw("phase", "1", 0.0, 1.0),), (), outside=True),
)  # fmt: skip
