"""Hidden friction: what raises or lowers the Coulomb friction of (13) as the machine moves.

Where the joint stands, the set-valued law holds it with the changed friction. Forms are siblings of
what the catalogue of a diagnosis has: rational for exponential, smooth for a step, and so on.
"""

import math

import numpy as np
from numba import njit

from crane_sim.effects.form import Draw, Form, Magnitude, Where, coulomb
from crane_sim.effects.working import FRICTION, Hidden
from crane_sim.parts.constants import Constants
from crane_sim.parts.rigid_bodies import Chain, beyond, carried, place
from crane_sim.parts.state import Scratch, State
from crane_sim.parts.vectors import dot, vector

(
    LORENTZ, SECH, ROUNDED_LOAD, WEIGHT, LIP, OVERHANG, WORN_ZONE, TWO_ZONES, TRIANGLE, RECTIFIED,
    KATO, JUMP, NEIGHBOUR,
) = range(FRICTION, FRICTION + 13)  # fmt: skip

LIP_PRESSURE = 5e6  # Pa, where the lip seal rubs as much as one of constant friction coefficient
FRONT_PAD = 1.1  # m from the joint before
OVERLAP = 0.4  # m between the pads of a telescope that is all out


@njit(cache=True, error_model="numpy")
def level(
    hidden: Hidden,
    k: int,
    i: int,
    constants: Constants,
    state: State,
    scratch: Scratch,
    step: float,
) -> float:
    """Coulomb friction [N m, N] that effect k adds at joint i, in both directions."""
    law, value, memory = hidden.law[k], hidden.value[k], hidden.memory[k]
    size = value[0]
    q, v = state.q[i], state.v[i]
    if law == LORENTZ:
        return size / (1.0 + (v / value[1]) ** 2)
    if law == SECH:
        return size / math.cosh(min(abs(v / value[1]), 300.0))
    if law == ROUNDED_LOAD:
        return size * math.hypot(scratch.force[i], value[1])
    if law == WEIGHT:
        return size * abs(scratch.bias[i])
    if law == LIP:
        cylinder, actuator = constants.cylinders[i], state.actuators[i]
        pressed = cylinder.area_a * _lip(actuator.p_a, value[1])
        pressed += cylinder.area_b * _lip(actuator.p_b, value[1])
        return size * abs(actuator.lever) * pressed
    if law == OVERHANG:
        return size * _pad_force(constants.chain, state.q, i, hidden.middle[k] + hidden.half[k])
    place = (q - hidden.middle[k]) / hidden.half[k]
    if law == WORN_ZONE:
        return size * math.exp(-(((place - value[1]) / value[2]) ** 2))
    if law == TWO_ZONES:
        return size * math.tanh((place - value[1]) / value[2])
    if law == TRIANGLE:
        return size * 2.0 / math.pi * math.asin(math.sin(value[1] * q + value[2]))
    if law == RECTIFIED:
        return size * (abs(math.sin(0.5 * value[1] * q + value[2])) - 2.0 / math.pi)
    if law == KATO:
        return size * _breakaway(memory, v, value[1], value[2], step)
    if law == JUMP:
        return size if hidden.clock[0] > value[1] else 0.0
    if law == NEIGHBOUR:  # the joint before this one, on the same frame, shakes its seals loose
        return size * abs(state.v[i - 1]) / value[1]
    raise ValueError("a law of friction has no branch in effects/friction.py: give it one")


@njit(cache=True, error_model="numpy")
def _lip(pressure: float, exponent: float) -> float:
    return LIP_PRESSURE * (max(pressure, 0.0) / LIP_PRESSURE) ** exponent


@njit(cache=True, error_model="numpy")
def _pad_force(chain: Chain, q: np.ndarray, i: int, longest: float) -> float:
    """Sum of the forces on the two pads of a telescope, a beam on two supports [N]."""
    place(chain, q)
    k = 1
    while chain.links[k].leader != i:
        k += 1
    mass, moment = beyond(chain, k)
    along, pull = vector(chain.links[k].slide), vector(chain.gravity)
    across = math.sqrt(max(dot(pull, pull) - dot(pull, along) ** 2, 0.0))
    before = carried(chain.links[k - 1], vector(chain.links[k - 1].point))
    weight = mass * across
    reach = dot(moment, along) - mass * dot(before, along)
    rear = across * (reach - mass * FRONT_PAD) / (longest + OVERLAP - q[i])
    return abs(weight + rear) + abs(rear)


@njit(cache=True, error_model="numpy")
def _breakaway(memory: np.ndarray, v: float, growth: float, travel: float, step: float) -> float:
    """Kato: grows with a power of the time at rest, and is gone after some travel.

    memory: time at rest, share at breakaway, travel since.
    """
    if v == 0.0:
        memory[0] += step
        memory[2] = 0.0
        memory[1] = max(memory[1], 1.0 - math.exp(-((memory[0] / growth) ** 0.6)))
        return memory[1]
    memory[0] = 0.0
    memory[2] += step * abs(v)
    left = 1.0 / (1.0 + (memory[2] / travel) ** 2)
    if left < 0.01:
        memory[1] = 0.0
    return memory[1] * left


_SIZE = Magnitude("f", "{force}", 0.1, 1.5, coulomb)
_SPEED = Draw("speed", "{coordinate}/s", 0.008, 0.05)
_PLACE, _WIDTH = Draw("place", "1", -0.35, 0.35), Draw("width", "1", 0.2, 0.5)
_WAVE, _PHASE = Draw("wave", "rad/{coordinate}", 8.0, 30.0), Draw("phase", "rad", 0.0, 2 * math.pi)
_MU = Magnitude("mu", "1", 0.02, 0.6)

FORMS = (
    Form("stribeck", "lorentz", LORENTZ, _SIZE, (_SPEED,)),
    Form("stribeck", "sech", SECH, _SIZE, (_SPEED,)),
    Form("stiction", "kato", KATO, _SIZE._replace(highest=5.0),
         (Draw("growth", "s", 0.3, 2.0), Draw("travel", "{coordinate}", 1e-3, 1e-2))),
    Form("load_friction", "rounded", ROUNDED_LOAD, _MU,
         (Draw("corner", "{force}", 0.1, 0.4, coulomb),)),
    Form("load_friction", "weight", WEIGHT, _MU),
    Form("seal_friction", "lip", LIP, _MU, (Draw("exponent", "1", 0.75, 1.0),)),
    Form("pad_friction", "overhang", OVERHANG, _MU, where=Where.SLIDING),
    Form("position_friction", "two_zones", TWO_ZONES, _SIZE, (_PLACE, _WIDTH), signed=True),
    Form("position_friction", "worn_zone", WORN_ZONE, _SIZE, (_PLACE, _WIDTH), signed=True),
    Form("cyclic_friction", "triangle", TRIANGLE, _SIZE, (_WAVE, _PHASE)),
    Form("cyclic_friction", "rectified", RECTIFIED, _SIZE, (_WAVE, _PHASE)),
    Form("wear_jump", "step", JUMP, _SIZE, (Draw("when", "s", 14.0, 24.0),), outside=True),
    Form("coupled_friction", "neighbour_speed", NEIGHBOUR, _SIZE,
         (Draw("speed", "rad/s", 0.05, 0.15),),  # of the boom before
         Where.FOLLOWING, outside=True),
)  # fmt: skip
