"""Hidden loads of the whole crane, and inertia of a drive: what adds to M and the bias of (6)."""

import math

import numpy as np
from numba import njit

from crane_sim.effects.form import Draw, Form, Magnitude, Where
from crane_sim.effects.working import LOADS, Hidden
from crane_sim.parts.rigid_bodies import Chain, add_push, beyond, mass_and_bias, place, tip_of
from crane_sim.parts.state import State
from crane_sim.parts.vectors import Vector, add_cross, cross, dot, product, scaled, summed, vector

BODY_AT_TIP, TILTED, HOSE, ROD, PENDULUM, GUSTS, CENTRIFUGAL = range(LOADS, LOADS + 7)

GUST = ((0.11, 1.0), (0.23, 0.8), (0.41, 0.6), (0.67, 0.5), (1.03, 0.35), (1.57, 0.25))  # Hz, share


@njit(cache=True, error_model="numpy")
def carry(hidden: Hidden, k: int, chain: Chain, state: State) -> None:
    """Fill inertia and bias that effect k adds at this instant."""
    law, value = hidden.law[k], hidden.value[k]
    mass, bias = hidden.mass[k], hidden.bias[k]
    mass[:] = 0.0
    bias[:] = 0.0
    q, v = state.q, state.v
    size = value[0]
    place(chain, q)
    if law == BODY_AT_TIP:
        _add_body(chain, v, size, value[1], size * value[2] ** 2, mass, bias)
    elif law == TILTED:
        _add_tilt(chain, size, bias)
    elif law == HOSE:
        _add_hose(chain, q, v, size, mass, bias)
    elif law == ROD:
        i = hidden.joint[k]
        lever, slope = state.actuators[i].lever, state.actuators[i].slope
        mass[i, i] = size * lever * lever
        bias[i] = size * lever * slope * v[i] * v[i]
    elif law == PENDULUM:
        _add_swing(hidden, k, chain, bias)
    elif law == CENTRIFUGAL:
        _note_centrifugal(chain, q, v, mass, bias)
    elif law == GUSTS:
        push = 0.0
        for n, (frequency, share) in enumerate(GUST):
            phase = 2.0 * math.pi * ((n + 1.0) * value[1] % 1.0)
            push += share * math.sin(2.0 * math.pi * frequency * hidden.clock[0] + phase)
        add_push(chain, tip_of(chain), scaled(-size * push, _outward(chain)), bias)
    else:
        raise ValueError("a law of a load has no branch in effects/loads.py: give it one")


@njit(cache=True, error_model="numpy")
def _outward(chain: Chain) -> Vector:
    """Horizontal unit vector from the axis of the base to the tip."""
    x, y, _ = tip_of(chain)
    radius = math.hypot(x, y)
    if radius < 1e-6:
        return 1.0, 0.0, 0.0
    return x / radius, y / radius, 0.0


@njit(cache=True, error_model="numpy")
def _add_body(
    chain: Chain, v: np.ndarray, m: float, reach: float, inertia: float,
    mass: np.ndarray, bias: np.ndarray,
) -> None:  # fmt: skip
    """A body of mass m whose centre lies `reach` beyond the tip, with the same inertia about all
    axes; by what its centre and its turning ask for.
    """
    links = chain.links
    at = summed(tip_of(chain), scaled(reach, product(links[-1].rotation, vector(chain.outward))))
    omega, alpha, velocity = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    acceleration = scaled(-1.0, vector(chain.gravity))
    for i in range(1, len(links)):  # of the last link, and its point that passes the origin
        rate, turn, slide = v[links[i].leader], vector(links[i].turn), vector(links[i].slide)
        alpha = add_cross(alpha, scaled(rate, omega), turn)
        acceleration = add_cross(acceleration, scaled(rate, omega), slide)
        acceleration = add_cross(acceleration, scaled(rate, velocity), turn)
        omega = summed(omega, scaled(rate, turn))
        velocity = summed(velocity, scaled(rate, slide))
    speed = add_cross(velocity, omega, at)
    needed = add_cross(add_cross(acceleration, alpha, at), omega, speed)
    add_push(chain, at, scaled(m, needed), bias)
    for i in range(1, len(links)):
        link, turn = links[i], vector(links[i].turn)
        way = add_cross(vector(link.slide), turn, at)
        bias[link.leader] += inertia * dot(turn, alpha)
        for k in range(1, len(links)):
            other, spun = links[k], vector(links[k].turn)
            shared = m * dot(way, add_cross(vector(other.slide), spun, at))
            mass[link.leader, other.leader] += shared + inertia * dot(turn, spun)


@njit(cache=True, error_model="numpy")
def _add_tilt(chain: Chain, angle: float, bias: np.ndarray) -> None:
    """Gravity of all bodies turned by `angle` in the plane of the booms, less that upright."""
    pull = -chain.gravity[2]
    outward, upward = scaled(pull * math.sin(angle), _outward(chain)), pull * (math.cos(angle) - 1)
    field = (outward[0], outward[1], upward)
    for i in range(1, len(chain.links)):
        link = chain.links[i]
        mass, moment = beyond(chain, i)
        bias[link.leader] += dot(vector(link.turn), cross(moment, field))
        bias[link.leader] += mass * dot(vector(link.slide), field)


@njit(cache=True, error_model="numpy")
def _add_hose(
    chain: Chain, q: np.ndarray, v: np.ndarray, density: float, mass: np.ndarray, bias: np.ndarray
) -> None:
    """Hose of q metres out of a reel, along every joint that slides, with weight and inertia.

    By Lagrange (3), with s of the hose out along u, which turns about the reel: T = density
    (s^3/3 |u'|^2 + s s'^2)/2, V = density g s^2/2 u_z. The way of the reel itself is left out.
    """
    pull, links = -chain.gravity[2], chain.links
    omega, alpha = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    for k in range(1, len(links)):
        link, j = links[k], links[k].leader
        if link.slides:
            u, out = vector(link.slide), max(q[j], 0.0)
            swing = cross(omega, u)
            turning = add_cross(cross(alpha, u), omega, swing)  # u'' without acceleration of joints
            for i in range(1, k):
                way, a = cross(vector(links[i].turn), u), links[i].leader
                bias[a] += density * (0.5 * pull * way[2] + v[j] * dot(way, swing)) * out * out
                bias[a] += density * out**3 / 3.0 * dot(way, turning)
                for n in range(1, k):
                    other = cross(vector(links[n].turn), u)
                    mass[a, links[n].leader] += density * out**3 / 3.0 * dot(way, other)
            mass[j, j] += density * out
            bias[j] += density * (0.5 * v[j] ** 2 - 0.5 * out * out * dot(swing, swing))
            bias[j] += density * pull * out * u[2]
        alpha = add_cross(alpha, scaled(v[j], omega), vector(link.turn))
        omega = summed(omega, scaled(v[j], vector(link.turn)))


@njit(cache=True, error_model="numpy")
def _note_centrifugal(
    chain: Chain, q: np.ndarray, v: np.ndarray, mass: np.ndarray, bias: np.ndarray
) -> None:
    """What slewing does to the booms. It is part of every machine: noted, not added."""
    rate, gravity = np.zeros_like(v), np.empty_like(v)
    mass_and_bias(chain, q, rate, mass, gravity)
    rate[0] = v[0]
    mass_and_bias(chain, q, rate, mass, bias)
    for i in range(len(v)):
        bias[i] -= gravity[i]
    mass[:] = 0.0


@njit(cache=True, error_model="numpy")
def _add_swing(hidden: Hidden, k: int, chain: Chain, bias: np.ndarray) -> None:
    """Force of the load's motion relative to the tip, as it was in the last step.

    memory: angle and rate of the pendulum, acceleration outward and upward relative to the tip.
    """
    size, memory = hidden.value[k, 0], hidden.memory[k]
    outward, at = scaled(size * memory[2], _outward(chain)), tip_of(chain)
    force = (outward[0], outward[1], size * memory[3])
    add_push(chain, at, force, bias)


@njit(cache=True, error_model="numpy")
def swing(
    hidden: Hidden, k: int, chain: Chain, q: np.ndarray, change: np.ndarray, step: float
) -> None:
    """A plane pendulum under the tip after a step that changed the velocities by `change` (j,).

    Angles of any size; what the tip's acceleration has from velocities alone is left out, as it is
    far below g.
    """
    value, memory = hidden.value[k], hidden.memory[k]
    length, damping = value[1], value[2]
    place(chain, q)
    gained = (0.0, 0.0, 0.0)  # velocity of the tip
    for i in range(1, len(chain.links)):
        link = chain.links[i]
        way = add_cross(vector(link.slide), vector(link.turn), tip_of(chain))
        gained = summed(gained, scaled(change[link.leader], way))
    pull = -chain.gravity[2]
    outward, upward = dot(gained, _outward(chain)) / step, gained[2] / step + pull
    angle, rate = memory[0], memory[1]
    turning = -(outward * math.cos(angle) + upward * math.sin(angle)) / length
    turning -= 2.0 * damping * math.sqrt(pull / length) * rate
    rate += step * turning
    memory[0], memory[1] = angle + step * rate, rate
    memory[2] = length * (turning * math.cos(angle) - rate * rate * math.sin(angle))
    memory[3] = length * (turning * math.sin(angle) + rate * rate * math.cos(angle))


FORMS = (
    Form("payload", "body", BODY_AT_TIP, Magnitude("mass", "kg", 8.0, 400.0),
         (Draw("reach", "m", 0.0, 0.3), Draw("gyration", "m", 0.1, 0.3)), Where.WHOLE),
    Form("base_tilt", "exact", TILTED, Magnitude("angle", "rad", 0.02, 0.35), (), Where.WHOLE,
         signed=True),
    Form("hose_mass", "reel", HOSE, Magnitude("density", "kg/m", 2.0, 60.0), (),
         Where.TELESCOPIC),
    Form("actuator_inertia", "rod", ROD, Magnitude("mass", "kg", 100.0, 20000.0)),
    Form("swinging_load", "pendulum", PENDULUM, Magnitude("mass", "kg", 10.0, 80.0),
         (Draw("length", "m", 0.4, 2.0), Draw("damping", "1", 0.01, 0.05)), Where.WHOLE),
    Form("slew_coupling", "slewing", CENTRIFUGAL, Magnitude("speed", "rad/s", 0.2, 0.38),
         (Draw("frequency", "rad/s", 0.5, 0.9),), Where.SLEWING),
    Form("wind", "gusts", GUSTS, Magnitude("force", "N", 20.0, 2000.0),
         (Draw("phase", "1", 0.0, 1.0),), Where.WHOLE, outside=True),
)  # fmt: skip
