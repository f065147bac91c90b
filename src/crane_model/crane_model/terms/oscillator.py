"""A damped oscillator carried along by a motion: what swings on a boom, or in it.

e'' + 2 damping w e' + w^2 e = -a, with e the displacement against the carrier, whose acceleration
is a, and w = 2 pi frequency. Its states are e and e'.
"""

import math

import numpy as np
from numba import njit

from crane_model.array import Array, Flags


@njit(cache=True)
def swung_once(
    e: float, rate: float, push: float, step: float, frequency: float, damping: float
) -> tuple[float, float]:
    """e and e' after a step [s], exact for an acceleration `push` that is constant."""
    w = 2.0 * math.pi * frequency
    ringing = w * math.sqrt(1.0 - damping**2)
    middle = -push / w**2
    x = e - middle
    fading = math.exp(-damping * w * step)
    cos, sin = math.cos(ringing * step), math.sin(ringing * step) / ringing
    return (
        middle + fading * (x * cos + (rate + damping * w * x) * sin),
        fading * (rate * cos - (damping * w * rate + w**2 * x) * sin),
    )


@njit(cache=True)
def swung(states: Array, push: Array, step: Array, frequency: float, damping: float) -> Array:
    """States (n, 2) after steps (n,) [s] with constant accelerations `push` (n,)."""
    out = np.empty_like(states)
    for n in range(len(states)):
        out[n, 0], out[n, 1] = swung_once(
            states[n, 0], states[n, 1], push[n], step[n], frequency, damping
        )
    return out


@njit(cache=True)
def swung_along(
    velocity: Array, time: Array, first: Flags, frequency: float, damping: float
) -> Array:
    """States (n, 2) on a carrier of velocity (n,); each run begins at rest on it."""
    states = np.zeros((len(velocity), 2))
    for k in range(1, len(velocity)):
        if not first[k]:
            step = time[k] - time[k - 1]
            push = (velocity[k] - velocity[k - 1]) / step
            states[k, 0], states[k, 1] = swung_once(
                states[k - 1, 0], states[k - 1, 1], push, step, frequency, damping
            )
    return states


def relative_acceleration(states: Array, carrier: Array, frequency: float, damping: float) -> Array:
    """e'' (n,), given the states (n, 2) and the acceleration (n,) of the carrier."""
    w = 2.0 * math.pi * frequency
    return -carrier - 2.0 * damping * w * states[:, 1] - w**2 * states[:, 0]
