"""Friction, drives and injected effects of the independent simulator."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numba import njit

from crane_model.cylinders import lever_arm
from crane_model.machine import Machine
from crane_sim.effects.form import Draw, Form, InjectedForm, Magnitude, coulomb, viscous

# Hidden effects of the other make at work: their parameters and memory, for compiled code.

EFFECT_VALUES = 6
RUBBING, PUSHING = 0, 100  # where the numbers of laws begin: of friction, of other forces


class IndependentEffects(NamedTuple):
    """k effects that act in the plant."""

    law: np.ndarray  # (k,) int
    joint: np.ndarray  # (k,) int
    value: (
        np.ndarray
    )  # (k, EFFECT_VALUES) the magnitude, then what is drawn, in the order of the form
    middle: np.ndarray  # (k,) of the range of the joint [rad, m]
    half: np.ndarray  # (k,) of the width of that range
    lever: np.ndarray  # (k,) m, 1: lever arm of the actuator in the middle
    memory: np.ndarray  # (k, 3)
    part: np.ndarray  # (k, j) what the drives must give more, after the last step [N m, N]


def pack_injected(injected: Sequence[InjectedForm], machine: Machine) -> IndependentEffects:
    """Those of `injected` that act in the plant; faults of sensors are left out."""
    inside = [
        effect
        for effect in injected
        if isinstance(effect.form.law, int) and effect.joint is not None
    ]
    joints = [str(effect.joint) for effect in inside]
    value = np.zeros((len(inside), EFFECT_VALUES))
    for row, effect in zip(value, inside, strict=True):
        row[: len(effect.values)] = effect.values
    limits = np.array(
        [
            (machine.limits[joint].position_min, machine.limits[joint].position_max)
            for joint in joints
        ]
    ).reshape(-1, 2)
    middle = limits.mean(axis=1)
    levers = [
        abs(lever_arm(machine, joint, middle[k : k + 1])[0]) for k, joint in enumerate(joints)
    ]
    return IndependentEffects(
        law=np.array([effect.form.law for effect in inside], dtype=np.int64),
        joint=np.array([machine.index(joint) for joint in joints], dtype=np.int64),
        value=value,
        middle=middle,
        half=np.ptp(limits, axis=1) / 2.0,
        lever=np.array(levers, dtype=float),
        memory=np.zeros((len(inside), 3)),
        part=np.zeros((len(inside), len(machine.joint_names))),
    )


# Laws of hidden friction of the other make: three of each effect, of random shape.
#
# They raise or lower the largest force of the bristles, in both directions.

(
    STRETCHED, HILL, RAMP, LOAD_POWER, LOAD_LEVELLING, LOAD_OF_WEIGHT, LIPS, NO_LEVER, ROD_SEAL,
    BUMP, TILT, CUBIC, HARMONICS, SAW, TRAPEZE, STUCK_POWER, STUCK_TWICE, STUCK_SQUEEZED,
) = range(RUBBING, RUBBING + 18)  # fmt: skip

STANDING = 1e-4  # rad/s, m/s, below which a joint counts as at rest
FIRM = 5e6  # Pa, where a lip rubs as much as one of constant friction coefficient


class Rubbed(NamedTuple):
    """Quantities that friction of a joint may depend on."""

    place: float  # -1..1 over the range
    q: float  # rad, m
    v: float  # rad/s, m/s
    load: float  # N m, N of the drive
    weight: float  # N m, N of gravity and Coriolis forces
    lever: float  # m, 1
    press_a: float  # Pa
    press_b: float  # Pa
    area_a: float  # m2, m3/rad
    area_b: float  # m2, m3/rad


@njit(cache=True, error_model="numpy")
def rubbing(
    law: int, value: np.ndarray, memory: np.ndarray, lever: float, at: Rubbed, step: float
) -> float:
    """Dry friction that effect `law` adds to its joint [N m, N].

    `value` (EFFECT_VALUES,): its magnitude, then its shape; `lever` is that in the middle of the
    range. Stiction after a rest advances its `memory` by `step` [s].
    """
    size, first, second, third = value[0], value[1], value[2], value[3]
    speed, load = abs(at.v), abs(at.load)
    if law == STRETCHED:
        return size * math.exp(-((speed / first) ** second))
    if law == HILL:
        return size / (1.0 + (speed / first) ** second)
    if law == RAMP:
        return size * max(1.0 - speed / first, 0.0) ** second
    if law == LOAD_POWER:
        return size * first * (load / first) ** second
    if law == LOAD_LEVELLING:
        return size * first * math.tanh(load / first)
    if law == LOAD_OF_WEIGHT:
        return size * (math.hypot(at.weight, first) - first)
    if law == LIPS:
        lips = at.area_a * _lip(at.press_a, first) + second * at.area_b * _lip(at.press_b, first)
        return size * abs(at.lever) * lips
    if law == NO_LEVER:  # as a seal that turns with the joint
        return size * lever * (at.area_a * max(at.press_a, 0.0) + at.area_b * max(at.press_b, 0.0))
    if law == ROD_SEAL:
        pressed = at.area_b * max(at.press_b, 0.0) + first * at.area_a * max(at.press_a, 0.0)
        return size * abs(at.lever) * pressed
    if law == BUMP:
        width = second if at.place < first else third
        return size / (1.0 + ((at.place - first) / width) ** 2)
    if law == TILT:
        return size * math.copysign(abs(at.place - first) ** second, at.place - first)
    if law == CUBIC:
        return size * (at.place * (1.0 + first * at.place) + second * at.place**3)
    phase = first * at.q + second
    if law == HARMONICS:
        return size * (math.sin(phase) + third * math.sin(2.0 * phase + second))
    if law == SAW:
        return size * math.atan2(third * math.sin(phase), 1.0 - third * math.cos(phase))
    if law == TRAPEZE:
        return size * math.tanh(math.sin(phase) / third)
    if law >= STUCK_POWER:
        return size * _stuck(law, first, second, memory, at.v, step)
    raise ValueError("a law of friction has no branch in independent/effects.py: give it one")


@njit(cache=True, error_model="numpy")
def _stuck(
    law: int, growth: float, travel: float, memory: np.ndarray, v: float, step: float
) -> float:
    """Share of what has grown at rest, and wears off along the way.

    memory: seconds at rest, rad or m since. Bristles that give way by a hair before a joint breaks
    away take that share of `travel` off the rest, and not all of it.
    """
    if abs(v) < STANDING:
        if memory[1] > 0.0:
            memory[0] *= max(1.0 - memory[1] / travel, 0.0)
            memory[1] = 0.0
        memory[0] += step
    else:
        memory[1] += step * abs(v)
    rest, way = memory[0] / growth, memory[1] / travel
    if law == STUCK_POWER:
        return rest**0.4 / (1.0 + rest**0.4) * math.exp(-way * way)
    if law == STUCK_TWICE:
        return (1.0 - 0.5 * math.exp(-rest) - 0.5 * math.exp(-0.1 * rest)) / (1.0 + way) ** 3
    if law == STUCK_SQUEEZED:  # oil that is squeezed out
        return rest / math.sqrt(1.0 + rest * rest) * max(1.0 - 0.3 * way, 0.0)
    raise ValueError("a law of friction has no branch in independent/effects.py: give it one")


@njit(cache=True, error_model="numpy")
def _lip(pressure: float, exponent: float) -> float:
    return FIRM * (max(pressure, 0.0) / FIRM) ** exponent


_FRICTION = Magnitude("f", "{force}", 0.1, 2.0, coulomb)
_MU = Magnitude("share", "1", 0.02, 0.6)
_SPEED = Draw("speed", "{coordinate}/s", 0.008, 0.05)
_BREAKAWAY = Magnitude("f", "{force}", 0.1, 5.0, coulomb)
_RESTED = (Draw("growth", "s", 0.3, 4.0), Draw("travel", "{coordinate}", 1e-3, 1e-2))
_PLACE = Draw("place", "1", -0.35, 0.35)
_FRICTION_WAVE = Draw("wave", "rad/{coordinate}", 8.0, 30.0)
_PHASE = Draw("phase", "rad", 0.0, 2 * math.pi)

FRICTION_FORMS = (
    Form("stribeck", "stretched", STRETCHED, _FRICTION, (_SPEED, Draw("exponent", "1", 0.7, 2.0))),
    Form("stribeck", "hill", HILL, _FRICTION, (_SPEED, Draw("exponent", "1", 1.5, 4.0))),
    Form("stribeck", "ramp", RAMP, _FRICTION,
         (Draw("speed", "{coordinate}/s", 0.02, 0.1), Draw("exponent", "1", 1.0, 2.0))),
    Form("stiction", "power", STUCK_POWER, _BREAKAWAY, _RESTED),
    Form("stiction", "twice", STUCK_TWICE, _BREAKAWAY, _RESTED),
    Form("stiction", "squeezed", STUCK_SQUEEZED, _BREAKAWAY, _RESTED),
    Form("load_friction", "power", LOAD_POWER, _MU,
         (Draw("about", "{force}", 1.0, 3.0, coulomb), Draw("exponent", "1", 0.75, 1.25))),
    Form("load_friction", "levelling", LOAD_LEVELLING, _MU,
         (Draw("about", "{force}", 3.0, 8.0, coulomb),)),
    Form("load_friction", "of_weight", LOAD_OF_WEIGHT, _MU,
         (Draw("corner", "{force}", 0.1, 0.6, coulomb),)),
    Form("seal_friction", "lips", LIPS, _MU,
         (Draw("exponent", "1", 0.7, 1.1), Draw("rod", "1", 0.6, 1.6))),
    Form("seal_friction", "no_lever", NO_LEVER, _MU),
    Form("seal_friction", "rod_seal", ROD_SEAL, _MU, (Draw("piston", "1", 0.0, 0.4),)),
    Form("position_friction", "bump", BUMP, _FRICTION,
         (_PLACE, Draw("below", "1", 0.2, 0.6), Draw("above", "1", 0.2, 0.6)), signed=True),
    Form("position_friction", "tilt", TILT, _FRICTION,
         (_PLACE, Draw("exponent", "1", 0.6, 1.6)), signed=True),
    Form("position_friction", "cubic", CUBIC, _FRICTION,
         (Draw("square", "1", -0.7, 0.7), Draw("cube", "1", -0.6, 0.6)), signed=True),
    Form("cyclic_friction", "harmonics", HARMONICS, _FRICTION,
         (_FRICTION_WAVE, _PHASE, Draw("second", "1", 0.0, 0.4))),
    Form("cyclic_friction", "saw", SAW, _FRICTION,
         (_FRICTION_WAVE, _PHASE, Draw("lean", "1", 0.3, 0.9))),
    Form("cyclic_friction", "trapeze", TRAPEZE, _FRICTION,
         (_FRICTION_WAVE, _PHASE, Draw("flank", "1", 0.2, 0.8))),
)  # fmt: skip


# Laws of other hidden forces of the other make: three of each effect, of random shape.

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
    size, first, second = value[0], value[1], value[2]
    if law == POWER:
        return size * math.copysign(abs(v) ** first, v)
    if law == THRESHOLD:
        return size * math.copysign(max(abs(v) - first, 0.0) ** second, v)
    if law == BLUNT:
        return size * v * v * v / (abs(v) + first)
    if law == ROUNDED_SPRING:
        return size * math.tanh((place - first) / second)
    if law == STIFFENING_SPRING:
        return size * math.sinh(second * (place - first)) / math.sinh(second)
    if law == SLACK_CORD:
        return size * max(place - first, 0.0) ** second
    if law in (POWER_BUFFER, TURBULENT_BUFFER, GAP_BUFFER):
        end = -place if value[3] < 0.5 else place  # one end alone, or both
        far = abs(place) if value[3] > 1.0 else end
        depth = min(max(1.0 - (1.0 - far) * half / first, 0.0), 1.0)
        if law == POWER_BUFFER:
            return size * v * depth**second
        if law == TURBULENT_BUFFER:
            return size * v * abs(v) / second * depth
        return size * v * depth * second / (1.0 + second - depth)
    if law == COOLING_EXPONENTIAL:
        return size * v * math.exp(-time / first)
    if law == COOLING_HYPERBOLA:
        return size * v / (1.0 + time / first) ** second
    if law == COOLING_TWICE:
        return (
            size
            * v
            * (second * math.exp(-time / first) + (1 - second) * math.exp(-time / (5.0 * first)))
        )
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
    size, first, second = value[0], value[1], value[2]
    if law == DETENT_SINE:
        return size * math.sin(first * q + second)
    if law == DETENT_WELLS:
        phase = first * q + second
        return size * math.sin(phase) * math.exp(value[3] * (math.cos(phase) - 1.0))
    if law == DETENT_ZIGZAG:
        return size * 2.0 / math.pi * math.asin(math.sin(first * q + second))
    way = step * v / first  # hoses: springs behind dampers, so that what stays bent relaxes
    if law == HOSE_LEVELS:
        memory[0] += way - step / second * memory[0]
        return size * math.tanh(memory[0])
    if law == HOSE_TWICE:
        memory[0] += way - step / second * memory[0]
        memory[1] += way - step / (second * value[3]) * memory[1]
        return size * (memory[0] + memory[1]) / 2.0
    if law == HOSE_DRAGS:
        memory[0] += way - step / second * memory[0] * abs(memory[0])
        return size * memory[0]
    raise ValueError("a law of a force has no branch in independent/effects.py: give it one")


_FORCE = Magnitude("f", "{force}", 0.1, 3.0, coulomb)
_LOSS = Magnitude("f", "{force} (s/{coordinate})^exponent", 2.0, 300.0, viscous)
_BRAKE = Magnitude("f", "{force} s/{coordinate}", 0.5, 100.0, viscous)
_COLD = Magnitude("f", "{force} s/{coordinate}", 0.1, 6.0, viscous)
_SEAL, _TRAVEL = (
    Magnitude("f", "{force}", 0.1, 2.0, coulomb),
    Draw("travel", "{coordinate}", 4e-3, 4e-2, ratio=True),
)
_SLACK = Draw("slack", "1", -0.8, 0.3)
_ZONE, _ENDS = Draw("zone", "{coordinate}", 0.1, 0.35), Draw("ends", "1", 0.0, 2.0)
_FORCE_WAVE = Draw("wave", "rad/{coordinate}", 20.0, 60.0)
_WARMING = Draw("warming", "s", 15.0, 60.0)
_REACH, _RELAXING = Draw("reach", "{coordinate}", 0.1, 0.4), Draw("relaxing", "s", 0.5, 3.0)

FORCE_FORMS = (
    Form("viscous_quadratic", "power", POWER, _LOSS, (Draw("exponent", "1", 1.5, 2.6),)),
    Form("viscous_quadratic", "threshold", THRESHOLD, _LOSS,
         (Draw("speed", "{coordinate}/s", 0.01, 0.08), Draw("exponent", "1", 1.2, 2.0))),
    Form("viscous_quadratic", "blunt", BLUNT, _LOSS,
         (Draw("speed", "{coordinate}/s", 0.02, 0.2),)),
    Form("hose_stiffness", "rounded", ROUNDED_SPRING, _FORCE,
         (_SLACK, Draw("width", "1", 0.5, 1.5))),
    Form("hose_stiffness", "stiffening", STIFFENING_SPRING, _FORCE,
         (_SLACK, Draw("steepness", "1", 0.5, 2.0))),
    Form("hose_stiffness", "cord", SLACK_CORD, _FORCE, (_SLACK, Draw("exponent", "1", 1.0, 1.6))),
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
    Form("detent", "sine", DETENT_SINE, _FORCE, (_FORCE_WAVE, _PHASE), outside=True),
    Form("detent", "wells", DETENT_WELLS, _FORCE,
         (_FORCE_WAVE, _PHASE, Draw("depth", "1", 0.5, 2.0)), outside=True),
    Form("detent", "zigzag", DETENT_ZIGZAG, _FORCE, (_FORCE_WAVE, _PHASE), outside=True),
    Form("relaxing_hose", "levels", HOSE_LEVELS, _FORCE, (_REACH, _RELAXING), outside=True),
    Form("relaxing_hose", "twice", HOSE_TWICE, _FORCE,
         (_REACH, _RELAXING, Draw("slower", "1", 2.0, 4.0)), outside=True),
    Form("relaxing_hose", "drags", HOSE_DRAGS, _FORCE, (_REACH, _RELAXING), outside=True),
)  # fmt: skip
