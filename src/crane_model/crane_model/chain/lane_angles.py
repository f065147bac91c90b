"""Cosine and sine of the joints of a block of samples, as `crane_model.chain.lanes` keeps them.

Those of the C library take one angle at a time; `tests/benchmarks/test_chain_speed.py` needs more.
"""

import math

from numba import njit

from crane_model.array import Array
from crane_model.chain.serial_chain import SerialChain

LANES = 8
COS, SIN, MOVED = 43, 44, 45  # rows of the workspace: of a joint that turns; way of one that slides

FAR = 1e5  # rad, from where on these digits of pi are too few
# pi/2 in three parts; the first two have so few digits that a whole number times them is exact
_HALF_PI_1, _HALF_PI_2 = 1.57079632673412561417, 6.07710050630396597660e-11
_HALF_PI_3 = 2.02226624879595063154e-21
# minimax on |x| <= pi/4: sin x = x + S3 x^3 + S5 x^5 ..., cos x = 1 - x^2 / 2 + C4 x^4 + ...
_S3, _S5, _S7 = -1.66666666666666324348e-01, 8.33333333332248946124e-03, -1.98412698298579493134e-04
_S9, _S11, _S13 = (
    2.75573137070700676789e-06,
    -2.50507602534068634195e-08,
    1.58969099521155010221e-10,
)
_C4, _C6, _C8 = 4.16666666666666019037e-02, -1.38888888888741095749e-03, 2.48015872894767294178e-05
_C10, _C12, _C14 = (
    -2.75573143513906633035e-07,
    2.08757232129817482790e-09,
    -1.13596475577881948265e-11,
)


@njit(cache=True)
def near(chain: SerialChain, q: Array) -> bool:
    """Whether no joint turns as far as FAR; not where an angle is no number."""
    for i in range(len(chain.ratio)):
        for n in range(len(q)):
            if not abs(chain.ratio[i] * q[n, chain.leader[i]]) < FAR:
                return False
    return True


@njit(cache=True)
def set_turn(s: Array) -> None:
    """cos and sin of the angles in `MOVED`, which become 0."""
    for lane in range(LANES):
        angle = s[MOVED * LANES + lane]
        s[COS * LANES + lane], s[SIN * LANES + lane] = math.cos(angle), math.sin(angle)
        s[MOVED * LANES + lane] = 0.0


@njit(cache=True)
def set_near_turn(s: Array) -> None:
    """The same of angles below FAR, several at once.

    The angle x less k quarter turns (Cody and Waite 1980), then the polynomials of FreeBSD's libm.
    """
    for lane in range(LANES):
        angle = s[MOVED * LANES + lane]
        k = math.floor(angle * (2.0 / math.pi) + 0.5)
        x = ((angle - k * _HALF_PI_1) - k * _HALF_PI_2) - k * _HALF_PI_3
        z = x * x
        sin = x + x * z * (_S3 + z * (_S5 + z * (_S7 + z * (_S9 + z * (_S11 + z * _S13)))))
        cos = _C4 + z * (_C6 + z * (_C8 + z * (_C10 + z * (_C12 + z * _C14))))
        cos = 1.0 - 0.5 * z + z * z * cos
        half = math.floor(0.5 * k)
        odd = k - 2.0 * half  # 1 where sine and cosine change places
        sign = 1.0 - 2.0 * (half - 2.0 * math.floor(0.5 * half))
        s[COS * LANES + lane] = sign * ((1.0 - odd) * cos - odd * sin)
        s[SIN * LANES + lane] = sign * (odd * cos + (1.0 - odd) * sin)
        s[MOVED * LANES + lane] = 0.0
