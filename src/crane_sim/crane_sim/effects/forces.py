"""Injected forces on one joint: by place, speed and time, and with a memory."""

import math

import numpy as np
from numba import njit

from crane_sim.effects.form import MEMORY, PUSHES, Draw, Form, Injected, Magnitude, coulomb, viscous
from crane_sim.parts.constants import Scratch, State

(
    POWER_LAW, ROUNDED_SQUARE, THRESHOLD, VISCOSITY, HYPERBOLIC, QUICK_AND_SLOW, SOFTENING, CORD,
    PROGRESSIVE, BUFFER, EARLY_BUFFER, ORIFICE_BUFFER, OVER_CENTRE, SNAP, TOGGLE, COGGING, WELLS,
    ZIGZAG,
) = range(PUSHES, PUSHES + 18)  # fmt: skip


@njit(cache=True, error_model="numpy")
def push(injected: Injected, k: int, i: int, state: State) -> float:
    """Force [N m, N] with which effect k resists at joint i."""
    law, value = injected.law[k], injected.value[k]
    size = value[0]
    q, v = state.q[i], state.v[i]
    if law == POWER_LAW:
        exponent = value[1]
        return math.copysign(size * abs(v) ** exponent, v)
    if law == ROUNDED_SQUARE:
        corner = value[1]
        return size * v * math.hypot(v, corner)
    if law == THRESHOLD:
        speed, exponent = value[1], value[2]
        return math.copysign(size * max(abs(v) - speed, 0.0) ** exponent, v)
    time, warming = injected.clock[0], value[1]
    if law == VISCOSITY:  # thins exponentially with the temperature, which rises towards its end
        thinning = value[2]
        cold = math.exp(thinning * math.exp(-time / warming))
        return size * v * (cold - 1.0) / (math.exp(thinning) - 1.0)
    if law == HYPERBOLIC:
        exponent = value[2]
        return size * v / (1.0 + time / warming) ** exponent
    if law == QUICK_AND_SLOW:  # first the oil of the hoses, then that of the tank
        quick = value[2]
        slow = math.exp(-time / (5.0 * warming))
        return size * v * (quick * math.exp(-time / warming) + (1.0 - quick) * slow)
    wave, offset = value[1], value[2]
    phase = wave * q + offset
    if law == COGGING:
        return size * math.sin(phase)
    if law == WELLS:
        depth = value[3]
        return size * math.sin(phase) * math.exp(depth * (math.cos(phase) - 1.0))
    if law == ZIGZAG:
        return size * 2.0 / math.pi * math.asin(math.sin(phase))
    return _where_it_stands(injected, k, q, v)


@njit(cache=True, error_model="numpy")
def _where_it_stands(injected: Injected, k: int, q: float, v: float) -> float:
    """Force that depends on the position within the range of the joint."""
    law, value = injected.law[k], injected.value[k]
    size = value[0]
    place = (q - injected.middle[k]) / injected.half[k]
    if law == SOFTENING:
        reach = value[1]
        return size * math.tanh(place / reach)
    slack = value[1]
    if law == CORD:  # pulls more and more as it is stretched, from where it is slack
        stretch = place - slack
        return size * (math.sqrt(stretch * stretch + 0.04) + stretch) / 2.0
    if law == PROGRESSIVE:
        steepness = value[2]
        return size * math.sinh(steepness * (place - slack)) / math.sinh(steepness)
    centre = value[1]
    ratio = place / centre
    if law == OVER_CENTRE:
        return size * ratio * (ratio * ratio - 1.0)
    if law == SNAP:
        return size * (math.tanh(4.0 * ratio) - ratio)
    if law == TOGGLE:
        return size * math.sin(math.pi * ratio)
    zone = value[1]
    before = (1.0 - abs(place)) * injected.half[k]  # rad, m, the end of the range
    if law == BUFFER:
        depth = max(0.0, 1.0 - before / zone)
        return size * v * depth * math.sqrt(depth)
    if law == EARLY_BUFFER:  # the piston's end comes before that of the range
        early, exponent = value[2], value[3]
        depth = min(max(0.0, 1.0 - (before - early) / zone), 1.0)
        return size * v * depth**exponent
    if law == ORIFICE_BUFFER:  # at one end alone
        speed, end = value[2], value[3]
        depth = max(0.0, 1.0 - before / zone)
        return size * v * abs(v) / speed * depth if place * end > 0.0 else 0.0
    raise ValueError("a law of a push has no branch in effects/forces.py: give it one")


_SIZE = Magnitude("f", "{force}", 0.1, 3.0, coulomb)
_PHASE = Draw("phase", "rad", 0.0, 2 * math.pi)
_LOSS = Magnitude("f_q", "{force} (s/{coordinate})^exponent", 2.0, 300.0, viscous)
_COLD = Magnitude("f_w", "{force} s/{coordinate}", 0.1, 4.0, viscous)
_WARMING = Draw("warming", "s", 20.0, 60.0)
_BRAKE = Magnitude("f_e", "{force} s/{coordinate}", 0.5, 100.0, viscous)
_ZONE = Draw("zone", "{coordinate}", 0.1, 0.3)
_CENTRE = (Draw("centre", "1", 0.4, 0.6),)
_TEETH = Draw("wave", "rad/{coordinate}", 20.0, 60.0)

PUSH_FORMS = (
    Form("viscous_quadratic", "power_law", POWER_LAW, _LOSS, (Draw("exponent", "1", 1.5, 2.6),)),
    Form("viscous_quadratic", "rounded", ROUNDED_SQUARE,
         Magnitude("f_q", "{force} s2/{coordinate}2", 2.0, 200.0, viscous),
         (Draw("corner", "{coordinate}/s", 0.005, 0.02),)),
    Form("viscous_quadratic", "threshold", THRESHOLD, _LOSS,
         (Draw("speed", "{coordinate}/s", 0.01, 0.06), Draw("exponent", "1", 1.2, 2.2))),
    Form("warm_up", "exponential_viscosity", VISCOSITY, _COLD,
         (_WARMING, Draw("thinning", "1", 0.4, 1.5))),
    Form("warm_up", "hyperbolic", HYPERBOLIC, _COLD, (_WARMING, Draw("exponent", "1", 1.0, 2.0))),
    Form("warm_up", "quick_and_slow", QUICK_AND_SLOW, _COLD,
         (Draw("warming", "s", 10.0, 30.0), Draw("quick", "1", 0.3, 0.7))),
    Form("hose_stiffness", "softening", SOFTENING, _SIZE, (Draw("reach", "1", 0.8, 1.6),)),
    Form("hose_stiffness", "cord", CORD, _SIZE, (Draw("slack", "1", -1.2, -0.6),)),
    Form("hose_stiffness", "progressive", PROGRESSIVE, _SIZE,
         (Draw("slack", "1", -0.6, 0.6), Draw("steepness", "1", 0.7, 3.0))),
    Form("end_cushioning", "buffer", BUFFER, _BRAKE, (_ZONE,)),
    Form("end_cushioning", "early", EARLY_BUFFER, _BRAKE,
         (_ZONE, Draw("before", "{coordinate}", 0.02, 0.12), Draw("exponent", "1", 0.5, 2.0))),
    Form("end_cushioning", "orifice", ORIFICE_BUFFER, _BRAKE,
         (_ZONE, Draw("speed", "{coordinate}/s", 0.05, 0.2), Draw("end", "1", -1.0, 1.0))),
    Form("cubic_spring", "over_centre", OVER_CENTRE, _SIZE, _CENTRE, outside=True),
    Form("cubic_spring", "snap", SNAP, _SIZE, _CENTRE, outside=True),
    Form("cubic_spring", "toggle", TOGGLE, _SIZE, _CENTRE, outside=True),
    Form("detent", "cogging", COGGING, _SIZE, (_TEETH, _PHASE), outside=True),
    Form("detent", "wells", WELLS, _SIZE,
         (_TEETH, _PHASE, Draw("depth", "1", 0.5, 2.0)), outside=True),
    Form("detent", "zigzag", ZIGZAG, _SIZE, (_TEETH, _PHASE), outside=True),
)  # fmt: skip


# Forces with a memory: bristles and slip blocks, play, hoses that relax.

(
    LUGRE, BOUC_WEN, DAHL, SLIP_BLOCKS, GRADED_BLOCKS, SOFT_BLOCKS,
    PIN_PLAY, BUSH_PLAY, TWO_PINS, RELAXING, LEVELS, SLACKENING,
) = range(MEMORY, MEMORY + 12)  # fmt: skip

SLIDING_SPEED = 2e-3  # rad/s, m/s; (13) holds with any force, no deviation from it shows
BLOCK_SHARES = ((0.1, 0.15), (0.35, 0.25), (0.65, 0.3), (1.0, 0.3))  # travel and force, as shares
GRADES = 6  # blocks, evenly spread over the travel
SOFT_EXPONENT = 4.0  # exponent of a block that slips by and by


@njit(cache=True, error_model="numpy")
def replaced(value: np.ndarray, scratch: Scratch, i: int) -> tuple[float, float]:
    """Take a share, value[1], of Coulomb friction (13) away, which presliding friction replaces.

    What is taken [N m, N], upwards and downwards.
    """
    law, share = scratch.law[i], value[1]
    taken = share * law.coulomb_up, share * law.coulomb_down
    law.coulomb_up *= 1.0 - share
    law.coulomb_down *= 1.0 - share
    return taken


@njit(cache=True, error_model="numpy")
def presliding(injected: Injected, k: int, v: float, step: float) -> float:
    """Share -1..1 of the friction that has built up over the displacement; advances the memory."""
    law, value, memory = injected.law[k], injected.value[k], injected.memory[k]
    travel, displacement = value[0], step * v
    if law == LUGRE:  # LuGre without a Stribeck curve: implicit in z, with damping
        damping, before = value[2], memory[0]
        z = (before + displacement / travel) / (1.0 + abs(displacement) / travel)
        memory[0] = z
        return z + damping * (z - before) / step
    if law == BOUC_WEN:
        exponent, z = value[2], memory[0]
        same = 1.0 if displacement * z > 0.0 else 0.0
        z += displacement / travel * (1.0 - same * abs(z) ** exponent)
        memory[0] = min(max(z, -1.0), 1.0)
        return memory[0]
    if law == DAHL:
        exponent, z = value[2], memory[0]
        left = 1.0 - math.copysign(1.0, displacement) * z
        z += displacement / travel * math.copysign(abs(left) ** exponent, left)
        memory[0] = min(max(z, -1.0), 1.0)
        return memory[0]
    share = 0.0
    if law == GRADED_BLOCKS:
        slope, total = value[2], 0.0
        for n in range(GRADES):
            reach = (n + 1.0) / GRADES
            memory[n] = min(max(memory[n] + displacement / (reach * travel), -1.0), 1.0)
            share += reach**slope * memory[n]
            total += reach**slope
        return share / total
    if law == SOFT_BLOCKS:
        for n, (reach, force) in enumerate(BLOCK_SHARES):
            same = 1.0 if displacement * memory[n] > 0.0 else 0.0
            memory[n] += (
                displacement / (reach * travel) * (1.0 - same * abs(memory[n]) ** SOFT_EXPONENT)
            )
            memory[n] = min(max(memory[n], -1.0), 1.0)
            share += force * memory[n]
        return share
    if law == SLIP_BLOCKS:  # elastic until each slips
        for n, (reach, force) in enumerate(BLOCK_SHARES):
            memory[n] = min(max(memory[n] + displacement / (reach * travel), -1.0), 1.0)
            share += force * memory[n]
        return share
    raise ValueError("a law with a memory has no branch in effects/forces.py: give it one")


@njit(cache=True, error_model="numpy")
def play(injected: Injected, k: int, load: float, q: float) -> float:
    """Force [N m, N] that the drive lacks until a pin that changed sides is seated, smoothly.

    memory: side of the load, where the pin stands in its clearance from -1 to 1, where the joint
    stood last. A load that turns again on the way finds the pin where it is by then. The load must
    exceed a small share of what it is about, so that its zero crossing is not counted twice.
    """
    law, value, memory = injected.law[k], injected.value[k], injected.memory[k]
    size, clearance, threshold = value[0], value[1], value[2]
    side, seat, last = memory[0], memory[1], memory[2]
    if abs(load) > threshold:
        if side == 0.0:
            seat, last = math.copysign(1.0, load), q
        side = math.copysign(1.0, load)
    displacement = 2.0 * abs(q - last) / clearance
    seat = min(max(seat + side * displacement, -1.0), 1.0)
    memory[0], memory[1], memory[2] = side, seat, q
    crossed = (1.0 + side * seat) / 2.0
    left = 1.0 - crossed
    if law == PIN_PLAY:
        left = 1.0 - crossed * crossed * (3.0 - 2.0 * crossed)
    elif law == BUSH_PLAY:  # rubber that takes the load bit by bit
        exponent = value[3]
        left = left**exponent
    elif law == TWO_PINS:  # of which one is seated before the other
        later = value[3]
        left = later * left + (1.0 - later) * max(1.0 - 3.0 * crossed, 0.0)
    else:
        raise ValueError("a law of a play has no branch in effects/forces.py: give it one")
    return -size * side * left


@njit(cache=True, error_model="numpy")
def hose(injected: Injected, k: int, v: float, step: float) -> float:
    """Force [N m, N] of a hose that is bent with the joint, and relaxes while it stays bent."""
    law, value, memory = injected.law[k], injected.value[k], injected.memory[k]
    size, reach, relaxing, bent = value[0], value[1], value[2], memory[0]
    displacement, rest = step * v / reach, step / relaxing
    if law == RELAXING:
        memory[0] = (bent + displacement) / (1.0 + rest)
        return size * memory[0]
    if law == LEVELS:  # stiff at first
        memory[0] = (bent + displacement) / (1.0 + rest)
        return size * math.tanh(2.0 * memory[0])
    if law == SLACKENING:  # the more it is bent, the sooner
        exponent = value[3]
        memory[0] = (bent + displacement) / (1.0 + rest * abs(bent) ** exponent)
        return size * memory[0]
    raise ValueError("a law of a hose has no branch in effects/forces.py: give it one")


_TRAVEL = Magnitude("travel", "{coordinate}", 3e-3, 6e-2)
_SHARE = Draw("share", "1", 0.5, 0.8)

_CLEARANCE = (Draw("clearance", "{coordinate}", 4e-3, 1.5e-2),
              Draw("threshold", "{force}", 0.02, 0.05, coulomb))  # fmt: skip
_LACKING = Magnitude("f_g", "{force}", 0.3, 3.0, coulomb)
_HOSE = Magnitude("f", "{force}", 0.1, 3.0, coulomb)
_RELAXING = (Draw("reach", "{coordinate}", 0.1, 0.4), Draw("relaxing", "s", 0.5, 4.0))

MEMORY_FORMS = (
    Form("presliding", "lugre", LUGRE, _TRAVEL, (_SHARE, Draw("damping", "s", 2e-3, 6e-3))),
    Form("presliding", "bouc_wen", BOUC_WEN, _TRAVEL, (_SHARE, Draw("exponent", "1", 1.5, 3.0))),
    Form("presliding", "dahl", DAHL, _TRAVEL, (_SHARE, Draw("exponent", "1", 0.6, 1.8))),
    Form("maxwell_slip", "four_blocks", SLIP_BLOCKS, _TRAVEL, (_SHARE,)),
    Form("maxwell_slip", "graded", GRADED_BLOCKS, _TRAVEL,
         (_SHARE, Draw("slope", "1", -0.5, 1.5))),
    Form("maxwell_slip", "soft_blocks", SOFT_BLOCKS, _TRAVEL, (_SHARE,)),
    Form("backlash", "pin", PIN_PLAY, _LACKING, _CLEARANCE),
    Form("backlash", "bush", BUSH_PLAY, _LACKING, (*_CLEARANCE, Draw("exponent", "1", 0.5, 2.0))),
    Form("backlash", "two_pins", TWO_PINS, _LACKING, (*_CLEARANCE, Draw("later", "1", 0.3, 0.7))),
    Form("relaxing_hose", "relaxing", RELAXING, _HOSE, _RELAXING, outside=True),
    Form("relaxing_hose", "levels", LEVELS, _HOSE, _RELAXING, outside=True),
    Form("relaxing_hose", "slackening", SLACKENING, _HOSE,
         (*_RELAXING, Draw("exponent", "1", 0.5, 1.5)), outside=True),
)  # fmt: skip
