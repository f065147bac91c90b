"""Laws of hidden friction of the other make: three of each effect, of random shape.

They raise or lower the largest force of the bristles, in both directions.
"""

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from crane_benchmark.away.hidden import RUBBING
from crane_sim.effects.form import Draw, Form, Magnitude, coulomb

(
    STRETCHED, HILL, RAMP, LOAD_POWER, LOAD_LEVELLING, LOAD_OF_WEIGHT, LIPS, NO_LEVER, ROD_SEAL,
    BUMP, TILT, CUBIC, HARMONICS, SAW, TRAPEZE, STUCK_POWER, STUCK_TWICE, STUCK_SQUEEZED,
) = range(RUBBING, RUBBING + 18)  # fmt: skip

STANDING = 1e-4  # rad/s, m/s, below which a joint counts as at rest
FIRM = 5e6  # Pa, where a lip rubs as much as one of constant friction coefficient


class Rubbed(NamedTuple):
    """What friction of a joint may depend on."""

    place: float  # -1..1 over the range
    q: float  # rad, m
    v: float  # rad/s, m/s
    load: float  # N m, N of the drive
    weight: float  # N m, N of gravity and Coriolis forces
    lever: float  # m, 1
    press_a: float  # Pa
    press_b: float  # Pa
    area_a: float  # m2, m3/rad
    area_b: float  # m2, m3/rad


@njit(cache=True, error_model="numpy")
def rubbing(
    law: int, value: np.ndarray, memory: np.ndarray, lever: float, at: Rubbed, step: float
) -> float:
    """What effect `law` adds to the dry friction of its joint [N m, N].

    `value` (VALUES,): its magnitude, then its shape; `lever` is that in the middle of the range.
    What sticks after a rest advances its `memory` by `step` [s].
    """
    size, one, two, three = value[0], value[1], value[2], value[3]
    speed, load = abs(at.v), abs(at.load)
    if law == STRETCHED:
        return size * math.exp(-((speed / one) ** two))
    if law == HILL:
        return size / (1.0 + (speed / one) ** two)
    if law == RAMP:
        return size * max(1.0 - speed / one, 0.0) ** two
    if law == LOAD_POWER:
        return size * one * (load / one) ** two
    if law == LOAD_LEVELLING:
        return size * one * math.tanh(load / one)
    if law == LOAD_OF_WEIGHT:
        return size * (math.hypot(at.weight, one) - one)
    if law == LIPS:
        lips = at.area_a * _lip(at.press_a, one) + two * at.area_b * _lip(at.press_b, one)
        return size * abs(at.lever) * lips
    if law == NO_LEVER:  # as a seal that turns with the joint
        return size * lever * (at.area_a * max(at.press_a, 0.0) + at.area_b * max(at.press_b, 0.0))
    if law == ROD_SEAL:
        pressed = at.area_b * max(at.press_b, 0.0) + one * at.area_a * max(at.press_a, 0.0)
        return size * abs(at.lever) * pressed
    if law == BUMP:
        width = two if at.place < one else three
        return size / (1.0 + ((at.place - one) / width) ** 2)
    if law == TILT:
        return size * math.copysign(abs(at.place - one) ** two, at.place - one)
    if law == CUBIC:
        return size * (at.place * (1.0 + one * at.place) + two * at.place**3)
    phase = one * at.q + two
    if law == HARMONICS:
        return size * (math.sin(phase) + three * math.sin(2.0 * phase + two))
    if law == SAW:
        return size * math.atan2(three * math.sin(phase), 1.0 - three * math.cos(phase))
    if law == TRAPEZE:
        return size * math.tanh(math.sin(phase) / three)
    if law >= STUCK_POWER:
        return size * _stuck(law, one, two, memory, at.v, step)
    raise ValueError("a law of friction has no branch in away/rubbing.py: give it one")


@njit(cache=True, error_model="numpy")
def _stuck(
    law: int, growth: float, travel: float, memory: np.ndarray, v: float, step: float
) -> float:
    """Share of what has grown at rest, and wears off along the way.

    memory: seconds at rest, rad or m since. Bristles that give way by a hair before a joint breaks
    away take that share of `travel` off the rest, and not all of it.
    """
    if abs(v) < STANDING:
        if memory[1] > 0.0:
            memory[0] *= max(1.0 - memory[1] / travel, 0.0)
            memory[1] = 0.0
        memory[0] += step
    else:
        memory[1] += step * abs(v)
    rest, way = memory[0] / growth, memory[1] / travel
    if law == STUCK_POWER:
        return rest**0.4 / (1.0 + rest**0.4) * math.exp(-way * way)
    if law == STUCK_TWICE:
        return (1.0 - 0.5 * math.exp(-rest) - 0.5 * math.exp(-0.1 * rest)) / (1.0 + way) ** 3
    if law == STUCK_SQUEEZED:  # oil that is squeezed out
        return rest / math.sqrt(1.0 + rest * rest) * max(1.0 - 0.3 * way, 0.0)
    raise ValueError("a law of friction has no branch in away/rubbing.py: give it one")


@njit(cache=True, error_model="numpy")
def _lip(pressure: float, exponent: float) -> float:
    return FIRM * (max(pressure, 0.0) / FIRM) ** exponent


_SIZE = Magnitude("f", "{force}", 0.1, 2.0, coulomb)
_MU = Magnitude("share", "1", 0.02, 0.6)
_SPEED = Draw("speed", "{coordinate}/s", 0.008, 0.05)
_BREAKAWAY = Magnitude("f", "{force}", 0.1, 5.0, coulomb)
_RESTED = (Draw("growth", "s", 0.3, 4.0), Draw("travel", "{coordinate}", 1e-3, 1e-2))
_PLACE = Draw("place", "1", -0.35, 0.35)
_WAVE, _PHASE = Draw("wave", "rad/{coordinate}", 8.0, 30.0), Draw("phase", "rad", 0.0, 2 * math.pi)

FORMS = (
    Form("stribeck", "stretched", STRETCHED, _SIZE, (_SPEED, Draw("exponent", "1", 0.7, 2.0))),
    Form("stribeck", "hill", HILL, _SIZE, (_SPEED, Draw("exponent", "1", 1.5, 4.0))),
    Form("stribeck", "ramp", RAMP, _SIZE,
         (Draw("speed", "{coordinate}/s", 0.02, 0.1), Draw("exponent", "1", 1.0, 2.0))),
    Form("stiction", "power", STUCK_POWER, _BREAKAWAY, _RESTED),
    Form("stiction", "twice", STUCK_TWICE, _BREAKAWAY, _RESTED),
    Form("stiction", "squeezed", STUCK_SQUEEZED, _BREAKAWAY, _RESTED),
    Form("load_friction", "power", LOAD_POWER, _MU,
         (Draw("about", "{force}", 1.0, 3.0, coulomb), Draw("exponent", "1", 0.75, 1.25))),
    Form("load_friction", "levelling", LOAD_LEVELLING, _MU,
         (Draw("about", "{force}", 3.0, 8.0, coulomb),)),
    Form("load_friction", "of_weight", LOAD_OF_WEIGHT, _MU,
         (Draw("corner", "{force}", 0.1, 0.6, coulomb),)),
    Form("seal_friction", "lips", LIPS, _MU,
         (Draw("exponent", "1", 0.7, 1.1), Draw("rod", "1", 0.6, 1.6))),
    Form("seal_friction", "no_lever", NO_LEVER, _MU),
    Form("seal_friction", "rod_seal", ROD_SEAL, _MU, (Draw("piston", "1", 0.0, 0.4),)),
    Form("position_friction", "bump", BUMP, _SIZE,
         (_PLACE, Draw("below", "1", 0.2, 0.6), Draw("above", "1", 0.2, 0.6)), signed=True),
    Form("position_friction", "tilt", TILT, _SIZE,
         (_PLACE, Draw("exponent", "1", 0.6, 1.6)), signed=True),
    Form("position_friction", "cubic", CUBIC, _SIZE,
         (Draw("square", "1", -0.7, 0.7), Draw("cube", "1", -0.6, 0.6)), signed=True),
    Form("cyclic_friction", "harmonics", HARMONICS, _SIZE,
         (_WAVE, _PHASE, Draw("second", "1", 0.0, 0.4))),
    Form("cyclic_friction", "saw", SAW, _SIZE, (_WAVE, _PHASE, Draw("lean", "1", 0.3, 0.9))),
    Form("cyclic_friction", "trapeze", TRAPEZE, _SIZE,
         (_WAVE, _PHASE, Draw("flank", "1", 0.2, 0.8))),
)  # fmt: skip
