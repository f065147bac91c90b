"""The state of the plant, and the room in which a step is worked out."""

from typing import NamedTuple

import numpy as np

ACTUATOR = ("length", "lever", "slope", "spool", "spool_rate", "p_a", "p_b")
"""Fields of an actuator's record: m, dx/dq, d2x/dq2; spool -1..1 (positive extends), 1/s; Pa."""


class State(NamedTuple):
    """All that changes; arrays (j,) from the base to the tip, but `supply` (1,)."""

    q: np.ndarray  # rad, m
    v: np.ndarray  # rad/s, m/s
    mode: np.ndarray  # int: sticking, or direction of motion
    bristle: np.ndarray  # rad, m: deflection with dynamic friction
    actuators: np.ndarray  # records, fields ACTUATOR
    supply: np.ndarray  # Pa


class Scratch(NamedTuple):
    """Room for the intermediate results of a step."""

    mass: np.ndarray  # (j, j)
    bias: np.ndarray  # (j,)
    force: np.ndarray  # (j,)
    impulse: np.ndarray  # (j,)
    friction: np.ndarray  # (j + 1, j)
    growth: np.ndarray  # (j,) piston speed, m/s
    before: np.ndarray  # (j,) velocities before the step
    law: np.ndarray  # records (j,): friction as hidden effects have changed it


def at_rest(q: np.ndarray, supply: float) -> State:
    """The pose q (j,), all else nil but the supply pressure [Pa]."""
    return State(
        q=q,
        v=np.zeros(len(q)),
        mode=np.zeros(len(q), dtype=np.int64),
        bristle=np.zeros(len(q)),
        actuators=np.zeros(len(q), np.dtype([(name, float) for name in ACTUATOR])),
        supply=np.array([supply]),
    )


def room(law: np.ndarray) -> Scratch:
    """Room for as many joints as there are records of friction (j,)."""
    joints = len(law)
    return Scratch(
        mass=np.zeros((joints, joints)),
        bias=np.zeros(joints),
        force=np.zeros(joints),
        impulse=np.zeros(joints),
        friction=np.zeros((joints + 1, joints)),
        growth=np.zeros(joints),
        before=np.zeros(joints),
        law=law.copy(),
    )
