"""Hidden forces on one joint that follow from where it stands, how fast it moves and when."""

import math

from numba import njit

from crane_sim.effects.form import Draw, Form, Magnitude, coulomb, viscous
from crane_sim.effects.working import PUSHES, Hidden
from crane_sim.parts.constants import State

(
    POWER_LAW, ROUNDED_SQUARE, THRESHOLD, VISCOSITY, HYPERBOLIC, QUICK_AND_SLOW, SOFTENING, CORD,
    PROGRESSIVE, BUFFER, EARLY_BUFFER, ORIFICE_BUFFER, OVER_CENTRE, SNAP, TOGGLE, COGGING, WELLS,
    ZIGZAG,
) = range(PUSHES, PUSHES + 18)  # fmt: skip


@njit(cache=True, error_model="numpy")
def push(hidden: Hidden, k: int, i: int, state: State) -> float:
    """Force [N m, N] with which effect k resists at joint i."""
    law, value = hidden.law[k], hidden.value[k]
    size = value[0]
    q, v = state.q[i], state.v[i]
    if law == POWER_LAW:
        return math.copysign(size * abs(v) ** value[1], v)
    if law == ROUNDED_SQUARE:
        return size * v * math.hypot(v, value[1])
    if law == VISCOSITY:  # thins exponentially with the temperature, which rises towards its end
        cold = math.exp(value[2] * math.exp(-hidden.clock[0] / value[1]))
        return size * v * (cold - 1.0) / (math.exp(value[2]) - 1.0)
    if law == THRESHOLD:
        return math.copysign(size * max(abs(v) - value[1], 0.0) ** value[2], v)
    if law == HYPERBOLIC:
        return size * v / (1.0 + hidden.clock[0] / value[1]) ** value[2]
    if law == QUICK_AND_SLOW:  # first the oil of the hoses, then that of the tank
        time, quick = hidden.clock[0], value[2]
        slow = math.exp(-time / (5.0 * value[1]))
        return size * v * (quick * math.exp(-time / value[1]) + (1.0 - quick) * slow)
    phase = value[1] * q + value[2]
    if law == COGGING:
        return size * math.sin(phase)
    if law == WELLS:
        return size * math.sin(phase) * math.exp(value[3] * (math.cos(phase) - 1.0))
    if law == ZIGZAG:
        return size * 2.0 / math.pi * math.asin(math.sin(phase))
    return _where_it_stands(hidden, k, q, v)


@njit(cache=True, error_model="numpy")
def _where_it_stands(hidden: Hidden, k: int, q: float, v: float) -> float:
    """Of a law that follows the place within the range of the joint."""
    law, value = hidden.law[k], hidden.value[k]
    size = value[0]
    place = (q - hidden.middle[k]) / hidden.half[k]
    if law == SOFTENING:
        return size * math.tanh(place / value[1])
    if law == CORD:  # pulls more and more as it is stretched, from where it is slack
        stretch = place - value[1]
        return size * (math.sqrt(stretch * stretch + 0.04) + stretch) / 2.0
    if law == PROGRESSIVE:
        return size * math.sinh(value[2] * (place - value[1])) / math.sinh(value[2])
    ratio = place / value[1]
    if law == OVER_CENTRE:
        return size * ratio * (ratio * ratio - 1.0)
    if law == SNAP:
        return size * (math.tanh(4.0 * ratio) - ratio)
    if law == TOGGLE:
        return size * math.sin(math.pi * ratio)
    before = (1.0 - abs(place)) * hidden.half[k]  # rad, m, the end of the range
    if law == BUFFER:
        depth = max(0.0, 1.0 - before / value[1])
        return size * v * depth * math.sqrt(depth)
    if law == EARLY_BUFFER:  # the piston's end comes before that of the range
        depth = min(max(0.0, 1.0 - (before - value[2]) / value[1]), 1.0)
        return size * v * depth ** value[3]
    if law == ORIFICE_BUFFER:  # at one end alone
        depth = max(0.0, 1.0 - before / value[1])
        return size * v * abs(v) / value[2] * depth if place * value[3] > 0.0 else 0.0
    raise ValueError("a law of a push has no branch in effects/pushes.py: give it one")


_SIZE = Magnitude("f", "{force}", 0.1, 3.0, coulomb)
_PHASE = Draw("phase", "rad", 0.0, 2 * math.pi)
_LOSS = Magnitude("f_q", "{force} (s/{coordinate})^exponent", 2.0, 300.0, viscous)
_COLD = Magnitude("f_w", "{force} s/{coordinate}", 0.1, 4.0, viscous)
_WARMING = Draw("warming", "s", 20.0, 60.0)
_BRAKE = Magnitude("f_e", "{force} s/{coordinate}", 0.5, 100.0, viscous)
_ZONE = Draw("zone", "{coordinate}", 0.1, 0.3)
_CENTRE = (Draw("centre", "1", 0.4, 0.6),)
_TEETH = Draw("wave", "rad/{coordinate}", 20.0, 60.0)

FORMS = (
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
