"""The linkages (20)-(26), compiled: cylinder length, lever arm and its derivative.

The scalar functions return (x, dx/dq, d2x/dq2) and can be called from a compiled simulation;
`motion` and `samples` take any linkage by its kind and constants. Lengths in m, angles rad.
Where a triangle degenerates they divide by zero as numpy does: the result is not finite.
"""

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from crane_model.array import Array


@njit(cache=True)
def triangle_side(side_1: float, side_2: float, angle: float) -> float:
    """The side opposite `angle` in a triangle (law of cosines)."""
    return math.sqrt(side_1**2 + side_2**2 - 2.0 * side_1 * side_2 * math.cos(angle))


@njit(cache=True, error_model="numpy")
def inner_boom(q2: float, j1: float, j2: float, angle_0: float) -> tuple[float, float, float]:
    """Cylinder of the inner boom (20); `angle_0` is pi/2 - phi4 + phi3."""
    angle = angle_0 + q2
    x = triangle_side(j1, j2, angle)
    first = j1 * j2 * math.sin(angle) / x
    second = (j1 * j2 * math.cos(angle) - first**2) / x
    return x, first, second


@njit(cache=True, error_model="numpy")
def _arccos_chain(u: float, du: float, ddu: float) -> tuple[float, float, float]:
    """arccos(u) with first and second derivative; nan outside [-1, 1] (the linkage is open)."""
    if not -1.0 < u < 1.0:
        return math.nan, math.nan, math.nan
    root = math.sqrt(1.0 - u * u)
    return math.acos(u), -du / root, -ddu / root - u * du * du / root**3


@njit(cache=True, error_model="numpy")
def outer_boom(
    q3: float,
    gamma_21_0: float,
    gamma_32: float,
    s22: float,
    s23: float,
    c1: float,
    c2: float,
    s31: float,
) -> tuple[float, float, float]:
    """Cylinder of the outer boom through its four-bar linkage (21)-(26).

    E is the elbow, P the pin of link c1 on the outer boom (EP = s22), R the pin of link c2 on the
    inner boom (ER = s23), K the cylinder's eye where the links meet, B the cylinder's base
    (EB = s31). The report does not give s33 = EK: it follows from closing the loop E-P-K-R with K
    outside the triangle E-P-R, the branch in which the linkage is assembled. `gamma_21_0` is
    pi/2 - beta1 + gamma25. nan where the links cannot reach each other.
    """
    gamma_21 = gamma_21_0 - q3  # (21)
    cos_21, sin_21 = math.cos(gamma_21), math.sin(gamma_21)
    # (22); derivatives are with respect to gamma_21, q3 = -gamma_21 + constant
    s24 = triangle_side(s22, s23, gamma_21)
    ds24 = s22 * s23 * sin_21 / s24
    dds24 = (s22 * s23 * cos_21 - ds24**2) / s24
    # directions seen from P: E-P-R is exact by atan2, R-P-K by the law of cosines
    epr = math.atan2(s23 * sin_21, s22 - s23 * cos_21)
    depr = (s22 * s23 * cos_21 - s23**2) / s24**2
    ddepr = (-s22 * s23 * sin_21 - 2.0 * depr * s24 * ds24) / s24**2
    a0 = (c1**2 - c2**2) / (2.0 * c1)
    u = a0 / s24 + s24 / (2.0 * c1)
    du = (-a0 / s24**2 + 0.5 / c1) * ds24
    ddu = (-a0 / s24**2 + 0.5 / c1) * dds24 + 2.0 * a0 / s24**3 * ds24**2
    rpk, drpk, ddrpk = _arccos_chain(u, du, ddu)
    angle, dangle, ddangle = epr + rpk, depr + drpk, ddepr + ddrpk
    # EK by closing the loop, and the direction of K seen from E (the arccos of (25), with its sign)
    along, across = s22 - c1 * math.cos(angle), c1 * math.sin(angle)
    dalong, dacross = c1 * math.sin(angle) * dangle, c1 * math.cos(angle) * dangle
    ddalong = c1 * (math.cos(angle) * dangle**2 + math.sin(angle) * ddangle)
    ddacross = c1 * (-math.sin(angle) * dangle**2 + math.cos(angle) * ddangle)
    # B in the same axes: its direction is gamma_21 - gamma_32 from EP, so that the angle
    # between EB and EK is gamma_31 of (25); the distance K-B is then (24)
    theta = gamma_21 - gamma_32
    rod_x, rod_y = along - s31 * math.cos(theta), across - s31 * math.sin(theta)
    drod_x, drod_y = dalong + s31 * math.sin(theta), dacross - s31 * math.cos(theta)
    ddrod_x, ddrod_y = ddalong + s31 * math.cos(theta), ddacross + s31 * math.sin(theta)
    x = math.sqrt(rod_x**2 + rod_y**2)
    first = (rod_x * drod_x + rod_y * drod_y) / x
    second = (drod_x**2 + drod_y**2 + rod_x * ddrod_x + rod_y * ddrod_y - first**2) / x
    return x, -first, second  # d/dq3 = -d/dgamma_21


@njit(cache=True)
def gamma_32(s31: float, s23: float, s32: float) -> float:
    """Angle at the elbow between s31 and s23 (26).

    The report prints the cosine with s32 and s23 exchanged; by (24)-(25) gamma_32 lies between s31
    and s23, hence opposite s32.
    """
    return math.acos((s31**2 + s23**2 - s32**2) / (2.0 * s31 * s23))


PROPORTIONAL, TRIANGLE, FOUR_BAR, TABLE = range(4)


class Linkage(NamedTuple):
    """x(q) of any actuator for compiled code: which kind, and its constants."""

    kind: int
    constants: Array


def tabulated(low: float, high: float, values: Array) -> Linkage:
    """Table of x, dx/dq and d2x/dq2 (k, 3) at k places from `low` to `high`, evenly apart."""
    return Linkage(TABLE, np.concatenate([[low, high], values.ravel()]))


@njit(cache=True, error_model="numpy")
def motion(kind: int, constants: Array, q: float) -> tuple[float, float, float]:
    """x, dx/dq, d2x/dq2 of a `Linkage` at q."""
    c = constants
    if kind == PROPORTIONAL:
        ratio = c[0]
        return ratio * q, ratio, 0.0
    if kind == TRIANGLE:
        return inner_boom(q, c[0], c[1], c[2])
    if kind == FOUR_BAR:
        sense = c[7]
        x, first, second = outer_boom(sense * q, c[0], c[1], c[2], c[3], c[4], c[5], c[6])
        return x, sense * first, second
    return _between(c, q)


@njit(cache=True)
def _between(table: Array, q: float) -> tuple[float, float, float]:
    """Quintic Hermite interpolation: x with both derivatives, as the table has them."""
    low, high, rows = table[0], table[1], table[2:].reshape(-1, 3)
    step = (high - low) / (len(rows) - 1)
    k = min(max(int((q - low) / step), 0), len(rows) - 2)
    s = (q - low) / step - k
    x0, v0, a0 = rows[k, 0], rows[k, 1] * step, rows[k, 2] * step**2
    x1, v1, a1 = rows[k + 1, 0], rows[k + 1, 1] * step, rows[k + 1, 2] * step**2
    dx, dv, da = x1 - x0 - v0 - a0 / 2.0, v1 - v0 - a0, a1 - a0
    c3 = 10.0 * dx - 4.0 * dv + da / 2.0
    c4 = -15.0 * dx + 7.0 * dv - da
    c5 = 6.0 * dx - 3.0 * dv + da / 2.0
    x = x0 + s * (v0 + s * (a0 / 2.0 + s * (c3 + s * (c4 + s * c5))))
    v = v0 + s * (a0 + s * (3.0 * c3 + s * (4.0 * c4 + s * 5.0 * c5)))
    a = a0 + s * (6.0 * c3 + s * (12.0 * c4 + s * 20.0 * c5))
    return x, v / step, a / step**2


@njit(cache=True)
def samples(kind: int, constants: Array, q: Array) -> Array:
    """`motion` at each of n places: (n, 3)."""
    out = np.empty((len(q), 3))
    for i in range(len(q)):
        out[i, 0], out[i, 1], out[i, 2] = motion(kind, constants, q[i])
    return out
