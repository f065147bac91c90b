"""Oil and valves of the other make, as compiled scalar functions.

Pressures are gauge [Pa], flows [m3/s], openings 0..1. Nothing here is shared with `crane_sim`.
"""

import math

from numba import njit

ATMOSPHERE = 1.01325e5  # Pa
POLYTROPE = 1.3  # of the bubbles
FLOW_NUMBER_DROP = 4e4  # Pa, about which an orifice turns from laminar to turbulent
MAKE_UP = 3e-7  # m3/s/sqrt(Pa), from the tank into a chamber below its pressure


@njit(cache=True, error_model="numpy", forceinline=True)
def orifice(gain: float, opening: float, drop: float) -> tuple[float, float]:
    """Flow through a metering edge, and its slope over the drop [m3/s/Pa], at least the secant.

    The discharge coefficient rises with the tanh of the flow number, itself with the root of the
    drop: laminar at small drops, K x sqrt(drop) at large ones.
    """
    if opening <= 0.0:
        return 0.0, 0.0
    size = abs(drop)
    if size < 1.0:  # Pa: the limit
        slope = gain * opening / math.sqrt(FLOW_NUMBER_DROP)
        return slope * drop, slope
    root = math.sqrt(size)
    flow = gain * opening * root * math.tanh(root / math.sqrt(FLOW_NUMBER_DROP))
    return math.copysign(flow, drop), flow / size


@njit(cache=True, error_model="numpy", forceinline=True)
def edge(spool: float, overlap: float) -> float:
    """Opening 0..1 of an edge that opens as the spool moves in its sense."""
    return min(max((spool - overlap) / (1.0 - overlap), 0.0), 1.0)


@njit(cache=True, error_model="numpy", forceinline=True)
def modulus(pressure: float, stiffness: float, stiffening: float, air: float) -> float:
    """Bulk modulus [Pa]: oil that stiffens with the pressure, and bubbles, `air` of the volume at
    atmospheric pressure, that are compressed by a polytrope.
    """
    absolute = max(pressure, 0.0) + ATMOSPHERE
    bubbles = air * (ATMOSPHERE / absolute) ** (1.0 / POLYTROPE)
    oil = stiffness + stiffening * max(pressure, 0.0)
    return (1.0 + bubbles) / (1.0 / oil + bubbles / (POLYTROPE * absolute))


@njit(cache=True, error_model="numpy", forceinline=True)
def relaxed(pressure: float, rate: float, slope: float, step: float) -> float:
    """Pressure after a step from which it rises at `rate`, pulled back by `slope` [1/s] of what it
    has risen: exponential Euler, stable for any step.
    """
    way = slope * step
    return pressure + rate * step * (-math.expm1(-way) / way if way > 1e-9 else 1.0)
