"""The spool of a valve: where it stands when, from the commands and when they came.

    u_s(t) = sense u(t - delay),   y'' + 2 D w y' + w^2 (y - u_s) = 0,   |y - z| <= play / 2
    o = max(0, z - d_A) / (1 - d_A) - max(0, -z - d_B) / (1 - d_B)

u is held from its own stamp until the next; y is the spool, of natural frequency w and damping
ratio D; z its edges, which trail by the hysteresis; o in -1..1 is the opening beyond the dead zones
d_A and d_B, positive where supply is open to chamber A. `sense` is +1 where extending the cylinder
moves the joint in its positive direction, else -1.

Source: second-order servo valve of Merritt, Hydraulic Control Systems (1967), ch. 7, with the
overlap of ch. 5; the play is the usual backlash operator (Visintin 1994).
"""

import math

import numpy as np
from numba import njit

from crane_model.array import Array


@njit(cache=True, error_model="numpy")
def transition(frequency: float, damping: float, time: float) -> tuple[float, float, float, float]:
    """exp(A time) of (y - u, y')' = A (y - u, y'), by rows; exact for a command that is held."""
    decay = damping * frequency
    square = frequency * frequency * (damping * damping - 1.0)
    if square < 0.0:
        turn = math.sqrt(-square)
        even, odd = math.cos(turn * time), math.sin(turn * time) / turn
    elif square > 0.0:
        turn = math.sqrt(square)
        even, odd = math.cosh(turn * time), math.sinh(turn * time) / turn
    else:
        even, odd = 1.0, time
    shrunk = math.exp(-decay * time)
    return (
        shrunk * (even + decay * odd),
        shrunk * odd,
        -shrunk * frequency * frequency * odd,
        shrunk * (even - decay * odd),
    )


@njit(cache=True, error_model="numpy")
def spool_course(
    stamps: Array, commands: Array, times: Array, frequency: float, damping: float
) -> Array:
    """y (n,) at increasing `times` (n,) [s], from commands (m,) held from their `stamps` (m,).

    It rests at the first command until the second one comes. frequency [rad/s].
    """
    out = np.empty(len(times))
    now, target, at, rate = stamps[0], commands[0], commands[0], 0.0
    following = 1
    for k in range(len(times)):
        while following < len(stamps) and stamps[following] <= times[k]:
            step = stamps[following] - now
            a, b, c, d = transition(frequency, damping, step)
            at, rate = target + a * (at - target) + b * rate, c * (at - target) + d * rate
            now, target = stamps[following], commands[following]
            following += 1
        step = times[k] - now
        if step > 0.0:
            a, b, c, d = transition(frequency, damping, step)
            at, rate = target + a * (at - target) + b * rate, c * (at - target) + d * rate
            now = times[k]
        out[k] = at
    return out


@njit(cache=True, error_model="numpy")
def move_spools(
    spools: Array, commands: Array, step: float, frequency: Array, damping: Array, play: Array
) -> Array:
    """z (S, N, j) in the middle of S steps [s] with commands (S, N, j), of N runs of j joints.

    `spools` (3, N, j) is y, y' and z, and is left as it is at the end; the others are (j,).
    """
    steps, runs, joints = commands.shape
    out = np.empty(commands.shape)
    y, rate, edge = spools[0], spools[1], spools[2]
    for j in range(joints):
        half = 0.5 * play[j]
        a, b, c, d = transition(frequency[j], damping[j], 0.5 * step)
        for n in range(runs):
            for s in range(steps):
                target = commands[s, n, j]
                for middle in (True, False):
                    off = y[n, j] - target
                    y[n, j] = target + a * off + b * rate[n, j]
                    rate[n, j] = c * off + d * rate[n, j]
                    edge[n, j] = min(y[n, j] + half, max(y[n, j] - half, edge[n, j]))
                    if middle:
                        out[s, n, j] = edge[n, j]
    return out


@njit(cache=True, error_model="numpy")
def trailing(y: Array, play: float) -> Array:
    """z (n,) of edges that trail a spool y (n,) by half the `play`, from where it begins."""
    out = y.copy()
    half = 0.5 * play
    for k in range(1, len(y)):
        out[k] = min(y[k] + half, max(y[k] - half, out[k - 1]))
    return out


@njit(cache=True, error_model="numpy")
def opening(z: float, dead_zone_a: float, dead_zone_b: float) -> float:
    """o of edges at z: nothing within the dead zones, 1 or -1 at the end of the stroke."""
    if z > dead_zone_a:
        return (z - dead_zone_a) / (1.0 - dead_zone_a)
    if z < -dead_zone_b:
        return (z + dead_zone_b) / (1.0 - dead_zone_b)
    return 0.0


@njit(cache=True, error_model="numpy")
def openings(z: Array, dead_zone_a: float, dead_zone_b: float) -> Array:
    """o (n,) of edges at z (n,)."""
    out = np.empty(len(z))
    for k in range(len(z)):
        out[k] = opening(z[k], dead_zone_a, dead_zone_b)
    return out
