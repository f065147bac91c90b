"""A hidden boom that bends: part of what a joint moves rides on two springs behind the joint.

Either mode carries a share of all that the joint moves, bent by e in the coordinate of the joint:
with M, h of (6) at q + e, q' + e', its own balance M_i (q'' + e'') + h_i = -k e - d e' gives e'',
and what it asks of every other joint, M_j (q'' + e'') + h_j, is the inertia and the weight of
bodies where they really are. k and d are constant, so that the frequency follows the pose.
"""

import math

import numpy as np
from numba import njit

from crane_sim.effects.form import Draw, Form, Magnitude
from crane_sim.effects.working import LOADS, Hidden
from crane_sim.parts.constants import Scratch
from crane_sim.parts.rigid_bodies import Chain, mass_and_bias

TWO_MODES, ONE_MODE, PROGRESSIVE = range(LOADS + 50, LOADS + 53)

MODES = ((1.0, 1.0), (2.7, 0.25))  # frequency and share, of those of the first
INERTIA = 4  # in the memory: after two deflections and their rates, that of the joint at the start
PASSES = 50  # in which a boom sags to where its springs hold it


@njit(cache=True, error_model="numpy", forceinline=True)
def carry(
    hidden: Hidden, k: int, chain: Chain, q: np.ndarray, v: np.ndarray, free: Scratch
) -> None:
    """Fill inertia and bias of what rides on the springs, less those of the same parts unbent.

    `free` has M and h of (6) without effects. e'' is eliminated, so that no step is too long for
    the light rest that does not bend; what it follows from is kept for `bend`.
    """
    value, memory, i = hidden.value[k], hidden.memory[k], hidden.joint[k]
    mass, bias = hidden.mass[k], hidden.bias[k]
    if memory[INERTIA] == 0.0:
        _sag(hidden, k, chain, q)
    count = _count(hidden.law[k])
    riding = 0.0
    for mode in range(count):
        riding += value[0] * MODES[mode][1]
    for a in range(len(q)):
        bias[a] = -riding * free.bias[a]
        for b in range(len(q)):
            mass[a, b] = -riding * free.mass[a, b]
    bent_mass, bent_bias = hidden.bent_mass, hidden.bent_bias
    for mode in range(count):
        share = value[0] * MODES[mode][1]
        _bent(hidden, k, mode, chain, q, v, bent_mass, bent_bias)
        push = bent_bias[i] + _spring(hidden, k, mode)
        for a in range(len(q)):
            lever = bent_mass[a, i] / bent_mass[i, i]
            hidden.slowing[k, mode, a] = lever
            bias[a] += share * (bent_bias[a] - lever * push)
            for b in range(len(q)):
                mass[a, b] += share * (bent_mass[a, b] - lever * bent_mass[i, b])
        hidden.slowing[k, mode, -1] = push / bent_mass[i, i]


@njit(cache=True, error_model="numpy", forceinline=True)
def bend(hidden: Hidden, k: int, change: np.ndarray, step: float) -> None:
    """Modes after a step that changed the velocities by `change` (j,); symplectic."""
    memory = hidden.memory[k]
    for mode in range(_count(hidden.law[k])):
        slowing = hidden.slowing[k, mode, -1]
        for a in range(len(change)):
            slowing += hidden.slowing[k, mode, a] * change[a] / step
        memory[2 + mode] -= step * slowing
        memory[mode] += step * memory[2 + mode]


@njit(cache=True, error_model="numpy", forceinline=True)
def _bent(
    hidden: Hidden, k: int, mode: int, chain: Chain, q: np.ndarray, v: np.ndarray,
    mass: np.ndarray, bias: np.ndarray,
) -> None:  # fmt: skip
    """M and h of (6) where the mode has bent the crane."""
    memory, i = hidden.memory[k], hidden.joint[k]
    straight_q, straight_v = q[i], v[i]
    q[i] += memory[mode]
    v[i] += memory[2 + mode]
    mass_and_bias(chain, q, v, mass, bias)
    q[i], v[i] = straight_q, straight_v


@njit(cache=True, error_model="numpy", forceinline=True)
def _spring(hidden: Hidden, k: int, mode: int) -> float:
    """k e + d e' of a mode that carried all of the inertia [N m, N]."""
    memory = hidden.memory[k]
    omega = 2.0 * math.pi * hidden.value[k, 1] * MODES[mode][0]
    damper = 2.0 * hidden.value[k, 2] * omega
    way = memory[mode]
    if hidden.law[k] == PROGRESSIVE:
        way *= 1.0 + (way / hidden.value[k, 3]) ** 2
    return memory[INERTIA] * (omega * omega * way + damper * memory[2 + mode])


@njit(cache=True, error_model="numpy")
def _count(law: int) -> int:
    """Modes of a law."""
    if law == TWO_MODES:
        return 2
    if law in (ONE_MODE, PROGRESSIVE):
        return 1
    raise ValueError("a law of a bend has no branch in effects/bending.py: give it one")


@njit(cache=True, error_model="numpy")
def _sag(hidden: Hidden, k: int, chain: Chain, q: np.ndarray) -> None:
    """The inertia that sets the springs, and where they hold the crane at rest."""
    memory, i = hidden.memory[k], hidden.joint[k]
    still, mass, bias = np.zeros(len(q)), np.empty((len(q), len(q))), np.empty(len(q))
    mass_and_bias(chain, q, still, mass, bias)
    memory[INERTIA] = mass[i, i]
    for mode in range(_count(hidden.law[k])):
        omega = 2.0 * math.pi * hidden.value[k, 1] * MODES[mode][0]
        for _ in range(PASSES):
            _bent(hidden, k, mode, chain, q, still, mass, bias)
            slope = omega**2 * memory[INERTIA]
            if hidden.law[k] == PROGRESSIVE:
                slope *= 1.0 + 3.0 * (memory[mode] / hidden.value[k, 3]) ** 2
            memory[mode] -= (bias[i] + _spring(hidden, k, mode)) / slope


_SHARE = Magnitude("share", "1", 0.1, 0.7)
_QUICK, _DAMPING = Draw("frequency", "Hz", 5.0, 12.0), Draw("damping", "1", 0.03, 0.15)

FORMS = (
    Form("boom_flexibility", "two_modes", TWO_MODES, _SHARE,
         (Draw("frequency", "Hz", 0.7, 12.0, ratio=True), _DAMPING)),
    Form("boom_flexibility", "one_mode", ONE_MODE, _SHARE, (_QUICK, _DAMPING)),
    Form("boom_flexibility", "progressive", PROGRESSIVE, _SHARE,
         (_QUICK, _DAMPING, Draw("softness", "{coordinate}", 3e-3, 2e-2))),
)  # fmt: skip
