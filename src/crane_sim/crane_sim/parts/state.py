"""The state of the plant, and the room in which a step is worked out."""

from typing import NamedTuple

import numpy as np

ACTUATOR = ("length", "lever", "spool", "spool_rate", "p_a", "p_b")
"""Fields of an actuator's record: cylinder m, dx/dq; spool -1..1 (positive extends), 1/s; Pa."""


class State(NamedTuple):
    """All that changes; arrays (4,) in the order of JOINTS, but `supply` (1,)."""

    q: np.ndarray  # rad, m
    v: np.ndarray  # rad/s, m/s
    mode: np.ndarray  # int: sticking, or direction of motion
    bristle: np.ndarray  # rad, m: deflection with dynamic friction
    actuators: np.ndarray  # records, fields ACTUATOR
    supply: np.ndarray  # Pa


class Scratch(NamedTuple):
    """Room for the intermediate results of a step."""

    mass: np.ndarray  # (4, 4)
    bias: np.ndarray  # (4,)
    force: np.ndarray  # (4,)
    impulse: np.ndarray  # (4,)
    friction: np.ndarray  # (5, 4)
    growth: np.ndarray  # (4,) piston speed, m/s
    before: np.ndarray  # (4,) velocities before the step
    law: np.ndarray  # records (4,): friction as hidden effects have changed it
