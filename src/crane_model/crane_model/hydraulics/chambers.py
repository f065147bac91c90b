"""The chambers of a cylinder: what the edges of the valve let in, and what that does.

    V_A/beta p_A' = Q_A - A_A x' - C (p_A - p_B),      V_A = V_0A + A_A (x - x_min)
    V_B/beta p_B' = Q_B + A_B x' + C (p_A - p_B),      V_B = V_0B + A_B (x_max - x)
    Q_A =  K_SA o r(p_S - p_A)   where o > 0,     K_AT o r(p_A - p_T)   where o < 0
    Q_B = -K_BT o r(p_B - p_T)   where o > 0,    -K_SB o r(p_S - p_B)   where o < 0
    r(d) = d / (d^2 + d_t^2)^(1/4)

with areas A and pressures p of (19), length x of (20) and (24), opening o of `spool`, gains K
[m3/s/sqrt(Pa)] of the four metering edges fully open, supply p_S and tank p_T, effective bulk
modulus beta, dead volumes V_0, and laminar leakage C past the piston. r is the orifice law
sqrt(d), turbulent, made linear below the drop d_t, where it is laminar.

Source: continuity of a compressible chamber and the orifice law, Merritt (1967), ch. 3 and 6;
the transition after Borutzky, Barnard, Thoma, Simul. Modell. Pract. Theory 10 (2002). The report
leaves this to future work (its section 5).
"""

import math

import numpy as np
from numba import njit

from crane_model.array import Array

TRANSITION = 1e5
"""Pa, d_t: well below any drop that moves a crane, so that its value hardly matters."""


@njit(cache=True, error_model="numpy")
def root(drop: float) -> float:
    """r(d) [sqrt(Pa)]: odd and increasing."""
    return drop / math.sqrt(math.sqrt(drop * drop + TRANSITION * TRANSITION))


@njit(cache=True, error_model="numpy")
def root_slope(drop: float) -> float:
    """dr/dd [1/sqrt(Pa)]."""
    square = drop * drop + TRANSITION * TRANSITION
    return (0.5 * drop * drop + TRANSITION * TRANSITION) / (square * math.sqrt(math.sqrt(square)))


def roots(drop: Array) -> Array:
    """r(d) of drops of any shape."""
    found: Array = drop / np.sqrt(np.hypot(drop, TRANSITION))
    return found
