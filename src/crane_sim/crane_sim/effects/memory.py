"""Hidden effects with a memory: bristles and slip blocks, play, hoses that relax."""

import math

import numpy as np
from numba import njit

from crane_sim.effects.form import Draw, Form, Magnitude, coulomb
from crane_sim.effects.working import MEMORY, Hidden
from crane_sim.parts.constants import Scratch

(
    BRISTLES, BOUC_WEN, DAHL, SLIP_BLOCKS, GRADED_BLOCKS, SOFT_BLOCKS,
    PIN_PLAY, BUSH_PLAY, TWO_PINS, RELAXING, LEVELS, SLACKENING,
) = range(MEMORY, MEMORY + 12)  # fmt: skip

STILL = 2e-3  # rad/s, m/s; below it (13) holds with any force, and no deviation from it shows
BLOCKS = ((0.1, 0.15), (0.35, 0.25), (0.65, 0.3), (1.0, 0.3))  # travel and force, as shares
GRADES = 6  # blocks, evenly spread over the travel
SOFT = 4.0  # exponent of a block that slips by and by


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
def presliding(hidden: Hidden, k: int, v: float, step: float) -> float:
    """Share -1..1 of the friction that has built up over the displacement; advances the memory."""
    law, value, memory = hidden.law[k], hidden.value[k], hidden.memory[k]
    travel, way = value[0], step * v
    if law == BRISTLES:  # LuGre without a Stribeck curve: implicit in z, with damping
        z = (memory[0] + way / travel) / (1.0 + abs(way) / travel)
        share = z + value[2] * (z - memory[0]) / step
        memory[0] = z
        return share
    if law == BOUC_WEN:
        same = 1.0 if way * memory[0] > 0.0 else 0.0
        memory[0] += way / travel * (1.0 - same * abs(memory[0]) ** value[2])
        memory[0] = min(max(memory[0], -1.0), 1.0)
        return memory[0]
    if law == DAHL:
        left = 1.0 - math.copysign(1.0, way) * memory[0]
        memory[0] += way / travel * math.copysign(abs(left) ** value[2], left)
        memory[0] = min(max(memory[0], -1.0), 1.0)
        return memory[0]
    share = 0.0
    if law == GRADED_BLOCKS:
        total = 0.0
        for n in range(GRADES):
            reach = (n + 1.0) / GRADES
            memory[n] = min(max(memory[n] + way / (reach * travel), -1.0), 1.0)
            share += reach ** value[2] * memory[n]
            total += reach ** value[2]
        return share / total
    if law == SOFT_BLOCKS:
        for n, (reach, force) in enumerate(BLOCKS):
            same = 1.0 if way * memory[n] > 0.0 else 0.0
            memory[n] += way / (reach * travel) * (1.0 - same * abs(memory[n]) ** SOFT)
            memory[n] = min(max(memory[n], -1.0), 1.0)
            share += force * memory[n]
        return share
    if law == SLIP_BLOCKS:  # elastic until each slips
        for n, (reach, force) in enumerate(BLOCKS):
            memory[n] = min(max(memory[n] + way / (reach * travel), -1.0), 1.0)
            share += force * memory[n]
        return share
    raise ValueError("a law with a memory has no branch in effects/memory.py: give it one")


@njit(cache=True, error_model="numpy")
def play(hidden: Hidden, k: int, load: float, q: float) -> float:
    """Force [N m, N] that the drive lacks until a pin that changed sides is seated, smoothly.

    memory: side of the load, where the pin stands in its clearance from -1 to 1, where the joint
    stood last. A load that turns again on the way finds the pin where it is by then. The load must
    exceed a small share of what it is about, so that its zero crossing is not counted twice.
    """
    law, value, memory = hidden.law[k], hidden.value[k], hidden.memory[k]
    size, clearance, threshold = value[0], value[1], value[2]
    if abs(load) > threshold:
        side = math.copysign(1.0, load)
        if memory[0] == 0.0:
            memory[1], memory[2] = side, q  # seated
        memory[0] = side
    way = 2.0 * abs(q - memory[2]) / clearance
    memory[1] = min(max(memory[1] + memory[0] * way, -1.0), 1.0)
    memory[2] = q
    crossed = (1.0 + memory[0] * memory[1]) / 2.0
    left = 1.0 - crossed
    if law == PIN_PLAY:
        left = 1.0 - crossed * crossed * (3.0 - 2.0 * crossed)
    elif law == BUSH_PLAY:  # rubber that takes the load bit by bit
        left = left ** value[3]
    elif law == TWO_PINS:  # of which one is seated before the other
        left = value[3] * left + (1.0 - value[3]) * max(1.0 - 3.0 * crossed, 0.0)
    else:
        raise ValueError("a law of a play has no branch in effects/memory.py: give it one")
    return -size * memory[0] * left


@njit(cache=True, error_model="numpy")
def hose(hidden: Hidden, k: int, v: float, step: float) -> float:
    """Force [N m, N] of a hose that is bent with the joint, and relaxes while it stays bent."""
    law, value, memory = hidden.law[k], hidden.value[k], hidden.memory[k]
    way, rest = step * v / value[1], step / value[2]
    if law == RELAXING:
        memory[0] = (memory[0] + way) / (1.0 + rest)
        return value[0] * memory[0]
    if law == LEVELS:  # stiff at first
        memory[0] = (memory[0] + way) / (1.0 + rest)
        return value[0] * math.tanh(2.0 * memory[0])
    if law == SLACKENING:  # the more it is bent, the sooner
        memory[0] = (memory[0] + way) / (1.0 + rest * abs(memory[0]) ** value[3])
        return value[0] * memory[0]
    raise ValueError("a law of a hose has no branch in effects/memory.py: give it one")


_TRAVEL = Magnitude("travel", "{coordinate}", 3e-3, 6e-2)
_SHARE = Draw("share", "1", 0.5, 0.8)

_CLEARANCE = (Draw("clearance", "{coordinate}", 4e-3, 1.5e-2),
              Draw("threshold", "{force}", 0.02, 0.05, coulomb))  # fmt: skip
_LACKING = Magnitude("f_g", "{force}", 0.3, 3.0, coulomb)
_HOSE = Magnitude("f", "{force}", 0.1, 3.0, coulomb)
_RELAXING = (Draw("reach", "{coordinate}", 0.1, 0.4), Draw("relaxing", "s", 0.5, 4.0))

FORMS = (
    Form("presliding", "lugre", BRISTLES, _TRAVEL, (_SHARE, Draw("damping", "s", 2e-3, 6e-3))),
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
