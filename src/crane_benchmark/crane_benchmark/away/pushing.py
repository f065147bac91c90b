"""Laws of other hidden forces of the other make: three of each effect, of random shape."""

import math

import numpy as np
from numba import njit

from crane_benchmark.away.hidden import PUSHING
from crane_sim.effects.form import Draw, Form, Magnitude, coulomb, viscous

(
    POWER, THRESHOLD, BLUNT, ROUNDED_SPRING, STIFFENING_SPRING, SLACK_CORD, POWER_BUFFER,
    TURBULENT_BUFFER, GAP_BUFFER, COOLING_EXPONENTIAL, COOLING_HYPERBOLA, COOLING_TWICE,
    SEAL_ROLLS, SEAL_YIELDS, SEAL_CREEPS, DETENT_SINE, DETENT_WELLS, DETENT_ZIGZAG, HOSE_LEVELS,
    HOSE_TWICE, HOSE_DRAGS,
) = range(PUSHING, PUSHING + 21)  # fmt: skip

STILL = 2e-3  # rad/s, m/s, below which dry friction is any force


@njit(cache=True, error_model="numpy")
def pushing(
    law: int, value: np.ndarray, memory: np.ndarray, place: float, half: float, q: float, v: float,
    time: float, step: float,
) -> float:  # fmt: skip
    """Force with which effect `law` resists at its joint [N m, N].

    `place` is -1..1 over the range, `half` of it [rad, m]; `time` [s] since the machine was
    started. Hoses with a memory advance theirs by `step` [s].
    """
    size, one, two = value[0], value[1], value[2]
    if law == POWER:
        return size * math.copysign(abs(v) ** one, v)
    if law == THRESHOLD:
        return size * math.copysign(max(abs(v) - one, 0.0) ** two, v)
    if law == BLUNT:
        return size * v * v * v / (abs(v) + one)
    if law == ROUNDED_SPRING:
        return size * math.tanh((place - one) / two)
    if law == STIFFENING_SPRING:
        return size * math.sinh(two * (place - one)) / math.sinh(two)
    if law == SLACK_CORD:
        return size * max(place - one, 0.0) ** two
    if law in (POWER_BUFFER, TURBULENT_BUFFER, GAP_BUFFER):
        end = -place if value[3] < 0.5 else place  # one end alone, or both
        far = abs(place) if value[3] > 1.0 else end
        depth = min(max(1.0 - (1.0 - far) * half / one, 0.0), 1.0)
        if law == POWER_BUFFER:
            return size * v * depth**two
        if law == TURBULENT_BUFFER:
            return size * v * abs(v) / two * depth
        return size * v * depth * two / (1.0 + two - depth)
    if law == COOLING_EXPONENTIAL:
        return size * v * math.exp(-time / one)
    if law == COOLING_HYPERBOLA:
        return size * v / (1.0 + time / one) ** two
    if law == COOLING_TWICE:
        return size * v * (two * math.exp(-time / one) + (1 - two) * math.exp(-time / (5.0 * one)))
    if law in (SEAL_ROLLS, SEAL_YIELDS, SEAL_CREEPS):
        return size * _built_up(law, value, memory, step * v, step)
    return _outside(law, value, memory, q, v, step)


@njit(cache=True, error_model="numpy")
def beyond_dry(law: int, value: np.ndarray, force: float, v: float) -> float:
    """Part of a force that no dry friction has: of one that builds up over the way, what it lacks.

    Coulomb friction of the same size is in every model.
    """
    if law in (SEAL_ROLLS, SEAL_YIELDS, SEAL_CREEPS):
        return force - math.copysign(value[0], v) if abs(v) > STILL else 0.0
    return force


@njit(cache=True, error_model="numpy")
def _built_up(law: int, value: np.ndarray, memory: np.ndarray, way: float, step: float) -> float:
    """Share -1..1 of a dry friction after a `way` [rad, m] more; value: its travel, its shape."""
    travel, shape = value[1], value[2]
    if law == SEAL_ROLLS:  # a ring that rolls in its groove before it slides
        memory[0] = min(max(memory[0] + way / travel, -1.0), 1.0)
        return math.copysign(abs(memory[0]) ** shape, memory[0])
    if law == SEAL_YIELDS:
        memory[0] = (memory[0] + way / travel) / (1.0 + abs(way) / travel)
        memory[1] = (memory[1] + shape * way / travel) / (1.0 + shape * abs(way) / travel)
        return (memory[0] + memory[1]) / 2.0
    memory[0] += way / travel  # and creeps back a little while it stands
    memory[0] = min(max(memory[0], -1.0), 1.0) * (1.0 - step / (100.0 * shape))
    return math.sin(0.5 * math.pi * memory[0])


@njit(cache=True, error_model="numpy")
def _outside(
    law: int, value: np.ndarray, memory: np.ndarray, q: float, v: float, step: float
) -> float:
    """Of effects that no catalogue has."""
    size, one, two = value[0], value[1], value[2]
    if law == DETENT_SINE:
        return size * math.sin(one * q + two)
    if law == DETENT_WELLS:
        phase = one * q + two
        return size * math.sin(phase) * math.exp(value[3] * (math.cos(phase) - 1.0))
    if law == DETENT_ZIGZAG:
        return size * 2.0 / math.pi * math.asin(math.sin(one * q + two))
    way = step * v / one  # hoses: springs behind dampers, so that what stays bent relaxes
    if law == HOSE_LEVELS:
        memory[0] += way - step / two * memory[0]
        return size * math.tanh(memory[0])
    if law == HOSE_TWICE:
        memory[0] += way - step / two * memory[0]
        memory[1] += way - step / (two * value[3]) * memory[1]
        return size * (memory[0] + memory[1]) / 2.0
    if law == HOSE_DRAGS:
        memory[0] += way - step / two * memory[0] * abs(memory[0])
        return size * memory[0]
    raise ValueError("a law of a force has no branch in away/pushing.py: give it one")


_SIZE = Magnitude("f", "{force}", 0.1, 3.0, coulomb)
_LOSS = Magnitude("f", "{force} (s/{coordinate})^exponent", 2.0, 300.0, viscous)
_BRAKE = Magnitude("f", "{force} s/{coordinate}", 0.5, 100.0, viscous)
_COLD = Magnitude("f", "{force} s/{coordinate}", 0.1, 6.0, viscous)
_SEAL, _TRAVEL = (
    Magnitude("f", "{force}", 0.1, 2.0, coulomb),
    Draw("travel", "{coordinate}", 4e-3, 4e-2, ratio=True),
)
_SLACK = Draw("slack", "1", -0.8, 0.3)
_ZONE, _ENDS = Draw("zone", "{coordinate}", 0.1, 0.35), Draw("ends", "1", 0.0, 2.0)
_WAVE, _PHASE = Draw("wave", "rad/{coordinate}", 20.0, 60.0), Draw("phase", "rad", 0.0, 2 * math.pi)
_WARMING = Draw("warming", "s", 15.0, 60.0)
_REACH, _RELAXING = Draw("reach", "{coordinate}", 0.1, 0.4), Draw("relaxing", "s", 0.5, 3.0)

FORMS = (
    Form("viscous_quadratic", "power", POWER, _LOSS, (Draw("exponent", "1", 1.5, 2.6),)),
    Form("viscous_quadratic", "threshold", THRESHOLD, _LOSS,
         (Draw("speed", "{coordinate}/s", 0.01, 0.08), Draw("exponent", "1", 1.2, 2.0))),
    Form("viscous_quadratic", "blunt", BLUNT, _LOSS,
         (Draw("speed", "{coordinate}/s", 0.02, 0.2),)),
    Form("hose_stiffness", "rounded", ROUNDED_SPRING, _SIZE,
         (_SLACK, Draw("width", "1", 0.5, 1.5))),
    Form("hose_stiffness", "stiffening", STIFFENING_SPRING, _SIZE,
         (_SLACK, Draw("steepness", "1", 0.5, 2.0))),
    Form("hose_stiffness", "cord", SLACK_CORD, _SIZE, (_SLACK, Draw("exponent", "1", 1.0, 1.6))),
    Form("end_cushioning", "power", POWER_BUFFER, _BRAKE,
         (_ZONE, Draw("exponent", "1", 0.5, 2.0), _ENDS)),
    Form("end_cushioning", "turbulent", TURBULENT_BUFFER, _BRAKE,
         (_ZONE, Draw("speed", "{coordinate}/s", 0.05, 0.2), _ENDS)),
    Form("end_cushioning", "gap", GAP_BUFFER, _BRAKE,
         (_ZONE, Draw("gap", "1", 0.1, 0.5), _ENDS)),
    Form("warm_up", "exponential", COOLING_EXPONENTIAL, _COLD, (_WARMING,)),
    Form("warm_up", "hyperbola", COOLING_HYPERBOLA, _COLD,
         (_WARMING, Draw("exponent", "1", 1.0, 2.0))),
    Form("warm_up", "twice", COOLING_TWICE, _COLD, (_WARMING, Draw("quick", "1", 0.3, 0.7))),
    Form("presliding", "rolls", SEAL_ROLLS, _SEAL, (_TRAVEL, Draw("shape", "1", 0.5, 1.0))),
    Form("presliding", "yields", SEAL_YIELDS, _SEAL, (_TRAVEL, Draw("quicker", "1", 1.5, 4.0))),
    Form("presliding", "creeps", SEAL_CREEPS, _SEAL, (_TRAVEL, Draw("slow", "s", 1.0, 5.0))),
    Form("detent", "sine", DETENT_SINE, _SIZE, (_WAVE, _PHASE), outside=True),
    Form("detent", "wells", DETENT_WELLS, _SIZE,
         (_WAVE, _PHASE, Draw("depth", "1", 0.5, 2.0)), outside=True),
    Form("detent", "zigzag", DETENT_ZIGZAG, _SIZE, (_WAVE, _PHASE), outside=True),
    Form("relaxing_hose", "levels", HOSE_LEVELS, _SIZE, (_REACH, _RELAXING), outside=True),
    Form("relaxing_hose", "twice", HOSE_TWICE, _SIZE,
         (_REACH, _RELAXING, Draw("slower", "1", 2.0, 4.0)), outside=True),
    Form("relaxing_hose", "drags", HOSE_DRAGS, _SIZE, (_REACH, _RELAXING), outside=True),
)  # fmt: skip
