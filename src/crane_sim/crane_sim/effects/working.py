"""Hidden effects at work: their parameters and memory, packed for compiled code."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from crane_model.cylinders import lever_arm
from crane_model.machine import Machine
from crane_sim.effects.form import Planted

# Numbers of laws, by where they act in a step. Whoever acts on a range refuses what it has no
# branch for; `END` is where the numbers end.
FRICTION, PUSHES, MEMORY, LOADS, FLOW, LEAKS, SOFTNESS, END = range(0, 800, 100)
VALUES = MEMORIES = 8
MODES = 2  # of a boom that bends, at most


class Hidden(NamedTuple):
    """k effects; arrays begin with k, an axis of j follows the joints."""

    law: np.ndarray  # int
    joint: np.ndarray  # int, -1: the whole machine
    value: np.ndarray  # (k, VALUES) parameters in the order of the form
    middle: np.ndarray  # (k,) of the range of the joint [rad, m]
    half: np.ndarray  # (k,) of the width of that range
    lever: np.ndarray  # (k,) m, 1: lever arm of the actuator in the middle; 1 of the whole machine
    memory: np.ndarray  # (k, MEMORIES) states, all zero at the start
    part: np.ndarray  # (k,) Coulomb friction, or force, that is added in this step
    mass: np.ndarray  # (k, j, j) inertia added in this step
    bias: np.ndarray  # (k, j) and forces that come with it
    slowing: np.ndarray  # (k, MODES, j + 1) of a mode that bends: -e'' by each q'', and without
    bent_mass: np.ndarray  # (j, j) room for M of a crane that is bent,
    bent_bias: np.ndarray  # (j,) and for h
    force: np.ndarray  # (k, j) what the drives must give more, after the last step
    flow: np.ndarray  # (k, j) what flows more into chamber A, m3/s
    clock: np.ndarray  # (1,) s since the machine was started
    meters: bool  # whether any of them acts in a valve
    leaks: bool  # whether any passes a piston
    softens: bool  # whether any gives way to pressure


def packed(planted: Sequence[Planted], machine: Machine, running: float = 0.0) -> Hidden | None:
    """Effects that act in the plant, `running` [s] after it was started; None if there is none.

    Faults of sensors are left out. Raises ValueError for a law whose number is in no range.
    """
    inside = [effect for effect in planted if isinstance(effect.form.law, int)]
    laws = [effect.form.law for effect in inside if isinstance(effect.form.law, int)]
    for effect, law in zip(inside, laws, strict=True):
        if not FRICTION <= law < END:
            raise ValueError(
                f"law '{effect.form.name}' of '{effect.form.effect}' has the number {law}, which "
                f"must be from {FRICTION} to {END - 1}: take one of the range where it acts"
            )
    count, joints = len(inside), len(machine.joint_names)
    if count == 0:
        return None
    value = np.zeros((count, VALUES))
    middle, half, lever = np.zeros(count), np.ones(count), np.ones(count)
    for k, effect in enumerate(inside):
        value[k, : len(effect.values)] = effect.values
        if effect.joint is not None:
            limits = machine.limits[effect.joint]
            middle[k] = (limits.position_max + limits.position_min) / 2.0
            half[k] = (limits.position_max - limits.position_min) / 2.0
            lever[k] = abs(lever_arm(machine, effect.joint, middle[k : k + 1])[0])
    return Hidden(
        law=np.array(laws, dtype=np.int64),
        joint=np.array(
            [-1 if effect.joint is None else machine.index(effect.joint) for effect in inside],
            dtype=np.int64,
        ),
        value=value,
        middle=middle,
        half=half,
        lever=lever,
        memory=np.zeros((count, MEMORIES)),
        part=np.zeros(count),
        mass=np.zeros((count, joints, joints)),
        bias=np.zeros((count, joints)),
        slowing=np.zeros((count, MODES, joints + 1)),
        bent_mass=np.zeros((joints, joints)),
        bent_bias=np.zeros(joints),
        force=np.zeros((count, joints)),
        flow=np.zeros((count, joints)),
        clock=np.array([running]),
        meters=any(FLOW <= law < LEAKS for law in laws),
        leaks=any(LEAKS <= law < SOFTNESS for law in laws),
        softens=any(law >= SOFTNESS for law in laws),
    )
