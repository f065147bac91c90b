"""Injected friction: what raises or lowers the Coulomb friction of (13) as the machine moves.

Where the joint stands, the set-valued law holds it with the changed friction. Forms are siblings of
what the catalogue of a diagnosis has: rational for exponential, smooth for a step, and so on.
"""

import math

import numpy as np
from numba import njit

from crane_sim.effects.form import FRICTION, Draw, Form, Injected, Magnitude, Where, coulomb
from crane_sim.parts.constants import Constants, Scratch, State
from crane_sim.parts.rigid_bodies import Chain, beyond, carried, dot, place, vector

(
    LORENTZ, SECH, HILL, ROUNDED_LOAD, WEIGHT, LOAD_POWER, LIP, NO_LEVER, ROD_SEAL, OVERHANG,
    FRONT, LEVELLING, WORN_ZONE, TWO_ZONES, TILTED_GUIDE, TRIANGLE, RECTIFIED, HARMONICS,
    KATO, LOGARITHM, HYPERBOLA, JUMP, RUNNING_DRY, SPELLS, NEIGHBOUR, NEIGHBOUR_SQUARE,
    NEIGHBOUR_SLOW,
) = range(FRICTION, FRICTION + 27)  # fmt: skip

BRISTLE_SPEED = 1e-5  # rad/s, m/s; bristles never stand quite still
LIP_PRESSURE_PA = 5e6  # where the lip seal rubs as much as one of constant friction coefficient
FRONT_PAD_M = 1.1  # from the joint before
MIN_OVERLAP_M = 0.4  # between the pads of a telescope that is all out


@njit(cache=True, error_model="numpy")
def level(
    injected: Injected,
    k: int,
    i: int,
    constants: Constants,
    state: State,
    scratch: Scratch,
    step: float,
) -> float:
    """Coulomb friction [N m, N] that effect k adds at joint i, in both directions."""
    law, value, v = injected.law[k], injected.value[k], state.v[i]
    size = value[0]
    speed = value[1]
    if law == LORENTZ:
        return size / (1.0 + (v / speed) ** 2)
    if law == SECH:
        return size / math.cosh(min(abs(v / speed), 300.0))
    if law == HILL:
        exponent = value[2]
        return size / (1.0 + abs(v / speed) ** exponent)
    force = value[1]
    if law == ROUNDED_LOAD:
        return size * math.hypot(scratch.force[i], force)
    if law == WEIGHT:
        return size * abs(scratch.bias[i])
    if law == LOAD_POWER:
        exponent = value[2]
        return size * force * (abs(scratch.force[i]) / force) ** exponent
    if law in (LIP, NO_LEVER, ROD_SEAL):
        return size * _seals(injected, k, constants.cylinders[i], state.actuators[i])
    if law in (OVERHANG, FRONT, LEVELLING):
        longest = injected.middle[k] + injected.half[k]
        front, rear = _pad_forces(constants.chain, state.q, i, longest)
        if law == FRONT:
            return size * front
        if law == LEVELLING:
            return size * force * math.tanh((front + rear) / force)
        return size * (front + rear)
    return _along_the_stroke(injected, k, i, state, step)


@njit(cache=True, error_model="numpy")
def _along_the_stroke(injected: Injected, k: int, i: int, state: State, step: float) -> float:
    """Friction that depends on the joint's position, its rest, or its load."""
    law, value, memory = injected.law[k], injected.value[k], injected.memory[k]
    size = value[0]
    q, v = state.q[i], state.v[i]
    place = (q - injected.middle[k]) / injected.half[k]
    centre, width = value[1], value[2]
    if law == WORN_ZONE:
        return size * math.exp(-(((place - centre) / width) ** 2))
    if law == TWO_ZONES:
        return size * math.tanh((place - centre) / width)
    if law == TILTED_GUIDE:
        exponent = value[2]
        return size * math.copysign(abs(place - centre) ** exponent, place - centre)
    wave, phase = value[1], value[2]
    if law == TRIANGLE:
        return size * 2.0 / math.pi * math.asin(math.sin(wave * q + phase))
    if law == RECTIFIED:
        return size * (abs(math.sin(0.5 * wave * q + phase)) - 2.0 / math.pi)
    if law == HARMONICS:
        angle, second = wave * q + phase, value[3]
        return size * (math.sin(angle) + second * math.sin(2.0 * angle + phase))
    if law in (KATO, LOGARITHM, HYPERBOLA):
        growth, travel = value[1], value[2]
        return size * _breakaway(law, memory, v, growth, travel, step)
    time = injected.clock[0]
    if law == JUMP:
        moment = value[1]
        return size if time > moment else 0.0
    if law == RUNNING_DRY:
        moment, growth = value[1], value[2]
        return size * (1.0 - math.exp(-max(time - moment, 0.0) / growth))
    if law == SPELLS:
        period, shift = value[1], value[2]
        return size if (time + shift) % period < 0.5 * period else 0.0
    neighbour, speed = state.v[i - 1], value[1]
    if law == NEIGHBOUR:  # the joint before this one, on the same frame, shakes its seals loose
        return size * abs(neighbour) / speed
    if law == NEIGHBOUR_SQUARE:
        return size * (neighbour / speed) ** 2
    if law == NEIGHBOUR_SLOW:
        return size / (1.0 + (neighbour / speed) ** 2)
    raise ValueError("a law of friction has no branch in effects/friction.py: give it one")


@njit(cache=True, error_model="numpy")
def _lip(pressure: float, exponent: float) -> float:
    return LIP_PRESSURE_PA * (max(pressure, 0.0) / LIP_PRESSURE_PA) ** exponent


@njit(cache=True, error_model="numpy")
def _seals(injected: Injected, k: int, cylinder: np.record, actuator: np.record) -> float:
    """Load on the seals of a cylinder, in the unit of the joint's force [N m, N]."""
    law, value = injected.law[k], injected.value[k]
    pressed_a = cylinder.area_a * max(actuator.p_a, 0.0)
    pressed_b = cylinder.area_b * max(actuator.p_b, 0.0)
    if law == LIP:
        exponent = value[1]
        pressed_a = cylinder.area_a * _lip(actuator.p_a, exponent)
        pressed_b = cylinder.area_b * _lip(actuator.p_b, exponent)
    elif law == ROD_SEAL:  # the piston's own ring does little
        share_a = value[1]
        pressed_a *= share_a
    else:  # a seal of the pin, with an arm of its own
        share_b = value[1]
        return injected.lever[k] * (pressed_a + share_b * pressed_b)
    return abs(actuator.lever) * (pressed_a + pressed_b)


@njit(cache=True, error_model="numpy")
def _pad_forces(chain: Chain, q: np.ndarray, i: int, longest: float) -> tuple[float, float]:
    """Forces on the front and the rear pad of a telescope, a beam on two supports [N]."""
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
    rear = across * (reach - mass * FRONT_PAD_M) / (longest + MIN_OVERLAP_M - q[i])
    return abs(weight + rear), abs(rear)


@njit(cache=True, error_model="numpy")
def _breakaway(
    law: int, memory: np.ndarray, v: float, growth: float, travel: float, step: float
) -> float:
    """Grows with the time at rest, and is gone after some travel.

    memory: time at rest, share at breakaway, travel since.
    """
    time, share, travelled = memory[0], memory[1], memory[2]
    if abs(v) < BRISTLE_SPEED:
        memory[0], memory[2] = time + step, 0.0
        rest = memory[0] / growth
        if law == KATO:
            grown = 1.0 - math.exp(-(rest**0.6))
        elif law == LOGARITHM:
            grown = math.log1p(rest)
        else:
            grown = rest / (1.0 + rest)
        memory[1] = max(share, grown)
        return memory[1]
    travelled += step * abs(v)
    memory[0], memory[2] = 0.0, travelled
    displacement = travelled / travel
    if law == KATO:
        left = 1.0 / (1.0 + displacement * displacement)
    elif law == LOGARITHM:
        left = math.exp(-displacement)
    else:
        left = max(1.0 - 0.5 * displacement, 0.0)
    if left < 0.01:
        share = 0.0
    memory[1] = share
    return share * left


_SIZE = Magnitude("f", "{force}", 0.1, 1.5, coulomb)
_SPEED = Draw("speed", "{coordinate}/s", 0.008, 0.05)
_PLACE, _WIDTH = Draw("place", "1", -0.35, 0.35), Draw("width", "1", 0.2, 0.5)
_WAVE, _PHASE = Draw("wave", "rad/{coordinate}", 8.0, 30.0), Draw("phase", "rad", 0.0, 2 * math.pi)
_MU = Magnitude("mu", "1", 0.02, 0.6)
_BREAKAWAY = _SIZE._replace(highest=5.0)
_REST = (Draw("growth", "s", 0.3, 3.0), Draw("travel", "{coordinate}", 1e-3, 1e-2))
_OF_BEFORE = (Draw("speed", "rad/s", 0.05, 0.15),)  # of the boom before

FRICTION_FORMS = (
    Form("stribeck", "lorentz", LORENTZ, _SIZE, (_SPEED,)),
    Form("stribeck", "sech", SECH, _SIZE, (_SPEED,)),
    Form("stribeck", "hill", HILL, _SIZE, (_SPEED, Draw("exponent", "1", 1.4, 4.0))),
    Form("stiction", "kato", KATO, _BREAKAWAY, _REST),
    Form("stiction", "logarithm", LOGARITHM, _BREAKAWAY, _REST),
    Form("stiction", "hyperbola", HYPERBOLA, _BREAKAWAY, _REST),
    Form("load_friction", "rounded", ROUNDED_LOAD, _MU,
         (Draw("corner", "{force}", 0.1, 0.4, coulomb),)),
    Form("load_friction", "weight", WEIGHT, _MU),
    Form("load_friction", "power", LOAD_POWER, _MU,
         (Draw("about", "{force}", 1.0, 3.0, coulomb), Draw("exponent", "1", 0.7, 1.3))),
    Form("seal_friction", "lip", LIP, _MU, (Draw("exponent", "1", 0.75, 1.0),)),
    Form("seal_friction", "no_lever", NO_LEVER, _MU, (Draw("rod", "1", 0.6, 1.6),)),
    Form("seal_friction", "rod_seal", ROD_SEAL, _MU, (Draw("piston", "1", 0.0, 0.4),)),
    Form("pad_friction", "overhang", OVERHANG, _MU, where=Where.SLIDING),
    Form("pad_friction", "front", FRONT, _MU, where=Where.SLIDING),
    Form("pad_friction", "levelling", LEVELLING, _MU, (Draw("about", "N", 1.5e3, 6e3),),
         Where.SLIDING),
    Form("position_friction", "two_zones", TWO_ZONES, _SIZE, (_PLACE, _WIDTH), signed=True),
    Form("position_friction", "worn_zone", WORN_ZONE, _SIZE, (_PLACE, _WIDTH), signed=True),
    Form("position_friction", "tilted_guide", TILTED_GUIDE, _SIZE,
         (_PLACE, Draw("exponent", "1", 0.6, 1.6)), signed=True),
    Form("cyclic_friction", "triangle", TRIANGLE, _SIZE, (_WAVE, _PHASE)),
    Form("cyclic_friction", "rectified", RECTIFIED, _SIZE, (_WAVE, _PHASE)),
    Form("cyclic_friction", "harmonics", HARMONICS, _SIZE,
         (_WAVE, _PHASE, Draw("second", "1", 0.1, 0.5))),
    Form("wear_jump", "step", JUMP, _SIZE, (Draw("when", "s", 14.0, 24.0),), outside=True),
    Form("wear_jump", "running_dry", RUNNING_DRY, _SIZE,
         (Draw("when", "s", 8.0, 20.0), Draw("within", "s", 3.0, 12.0)), outside=True),
    Form("wear_jump", "spells", SPELLS, _SIZE,
         (Draw("every", "s", 7.0, 23.0), Draw("from", "s", 0.0, 20.0)), outside=True),
    Form("coupled_friction", "neighbour_speed", NEIGHBOUR, _SIZE, _OF_BEFORE,
         Where.FOLLOWING, outside=True),
    Form("coupled_friction", "neighbour_square", NEIGHBOUR_SQUARE, _SIZE, _OF_BEFORE,
         Where.FOLLOWING, outside=True),
    Form("coupled_friction", "neighbour_slow", NEIGHBOUR_SLOW, _SIZE,
         (Draw("speed", "rad/s", 0.02, 0.06),), Where.FOLLOWING, outside=True),
)  # fmt: skip
