"""Hidden effects of the other make at work: their parameters and memory, for compiled code."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from crane_model.cylinders import lever_arm
from crane_model.machine import Machine
from crane_sim.effects.form import Planted

VALUES = 6
RUBBING, PUSHING = 0, 100  # where the numbers of laws begin: of friction, of other forces


class AwayHidden(NamedTuple):
    """k effects that act in the plant."""

    law: np.ndarray  # (k,) int
    joint: np.ndarray  # (k,) int
    value: np.ndarray  # (k, VALUES) the magnitude, then what is drawn, in the order of the form
    middle: np.ndarray  # (k,) of the range of the joint [rad, m]
    half: np.ndarray  # (k,) of the width of that range
    lever: np.ndarray  # (k,) m, 1: lever arm of the actuator in the middle
    memory: np.ndarray  # (k, 3)
    part: np.ndarray  # (k, j) what the drives must give more, after the last step [N m, N]


def pack_hidden(planted: Sequence[Planted], machine: Machine) -> AwayHidden:
    """Those of `planted` that act in the plant; faults of sensors are left out."""
    inside = [one for one in planted if isinstance(one.form.law, int) and one.joint is not None]
    joints = [str(one.joint) for one in inside]
    value = np.zeros((len(inside), VALUES))
    for row, one in zip(value, inside, strict=True):
        row[: len(one.values)] = one.values
    limits = np.array(
        [(machine.limits[one].position_min, machine.limits[one].position_max) for one in joints]
    ).reshape(-1, 2)
    middle = limits.mean(axis=1)
    levers = [
        abs(lever_arm(machine, joint, middle[k : k + 1])[0]) for k, joint in enumerate(joints)
    ]
    return AwayHidden(
        law=np.array([one.form.law for one in inside], dtype=np.int64),
        joint=np.array([machine.index(one) for one in joints], dtype=np.int64),
        value=value,
        middle=middle,
        half=np.ptp(limits, axis=1) / 2.0,
        lever=np.array(levers, dtype=float),
        memory=np.zeros((len(inside), 3)),
        part=np.zeros((len(inside), len(machine.joint_names))),
    )
