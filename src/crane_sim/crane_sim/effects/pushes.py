"""Hidden forces on one joint that follow from where it stands, how fast it moves and when."""

import math

from numba import njit

from crane_sim.effects.form import Draw, Form, Magnitude, coulomb, viscous
from crane_sim.effects.working import PUSHES, Hidden
from crane_sim.parts.state import State

(
    POWER_LAW, ROUNDED_SQUARE, SOFTENING, CORD, VISCOSITY, BUFFER, OVER_CENTRE, COGGING,
) = range(PUSHES, PUSHES + 8)  # fmt: skip


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
    if law == COGGING:
        return size * math.sin(value[1] * q + value[2])
    place = (q - hidden.middle[k]) / hidden.half[k]
    if law == SOFTENING:
        return size * math.tanh(place / value[1])
    if law == CORD:  # pulls more and more as it is stretched, from where it is slack
        stretch = place - value[1]
        return size * (math.sqrt(stretch * stretch + 0.04) + stretch) / 2.0
    if law == OVER_CENTRE:
        ratio = place / value[1]
        return size * ratio * (ratio * ratio - 1.0)
    if law == BUFFER:
        depth = max(0.0, 1.0 - (1.0 - abs(place)) * hidden.half[k] / value[1])
        return size * v * depth * math.sqrt(depth)
    raise ValueError("a law of a push has no branch in effects/pushes.py: give it one")


_SIZE = Magnitude("f", "{force}", 0.1, 3.0, coulomb)
_PHASE = Draw("phase", "rad", 0.0, 2 * math.pi)

FORMS = (
    Form("viscous_quadratic", "power_law", POWER_LAW,
         Magnitude("f_q", "{force} (s/{coordinate})^exponent", 2.0, 200.0, viscous),
         (Draw("exponent", "1", 1.7, 1.9),)),
    Form("viscous_quadratic", "rounded", ROUNDED_SQUARE,
         Magnitude("f_q", "{force} s2/{coordinate}2", 2.0, 200.0, viscous),
         (Draw("corner", "{coordinate}/s", 0.005, 0.02),)),
    Form("warm_up", "exponential_viscosity", VISCOSITY,
         Magnitude("f_w", "{force} s/{coordinate}", 0.1, 4.0, viscous),
         (Draw("warming", "s", 20.0, 60.0), Draw("thinning", "1", 0.4, 1.5))),
    Form("hose_stiffness", "softening", SOFTENING, _SIZE, (Draw("reach", "1", 0.8, 1.6),)),
    Form("hose_stiffness", "cord", CORD, _SIZE, (Draw("slack", "1", -1.2, -0.6),)),
    Form("end_cushioning", "buffer", BUFFER,
         Magnitude("f_e", "{force} s/{coordinate}", 0.5, 100.0, viscous),
         (Draw("zone", "{coordinate}", 0.1, 0.3),)),
    Form("cubic_spring", "over_centre", OVER_CENTRE, _SIZE,
         (Draw("centre", "1", 0.4, 0.6),), outside=True),
    Form("detent", "cogging", COGGING, _SIZE,
         (Draw("wave", "rad/{coordinate}", 20.0, 60.0), _PHASE), outside=True),
)  # fmt: skip
