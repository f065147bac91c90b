"""The crane of the report among all serial arms: two booms and a telescope in an upright plane."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from crane_model.array import Array
from crane_model.machine.joint import MachineJoint, Origin

WEIGHED = ("S_FL_along", "S_SL_along", "m_TL")
"""Base parameters that gravity shows: mass moments of the two booms, mass of the telescope."""

_KINDS = ("revolute", "revolute", "prismatic")
_CLOSE = 1e-9  # rad, m


class PlanarCrane(NamedTuple):
    """The constants of Table 1 that matter in the plane [m, rad, m/s2]."""

    joints: tuple[str, str, str]  # inner boom, outer boom, telescope
    base_height: float  # d1, of joint 2
    theta_2_0: float  # from q2 to the line from joint 2 to the elbow
    inner_boom_length: float  # a2
    telescope_offset: float  # a3, along the normal of the telescope's axis
    telescope_length: float  # d4,0: elbow to tip along the axis at q4 = 0
    gravity: float


def planar_crane(
    joints: Sequence[MachineJoint], base: Origin, tool: Origin, gravity: Array
) -> PlanarCrane | None:
    """The constants if the last three joints are those of Table 1, else None.

    Whatever turns before them turns about the vertical, so that their plane stays upright.
    """
    if len(joints) < 3 or tool != Origin() or any(joint.follows for joint in joints):
        return None
    *before, inner, outer, telescope = joints
    first, second, third = inner.dh, outer.dh, telescope.dh
    kinds = tuple(joint.kind for joint in (inner, outer, telescope))
    if first is None or second is None or third is None or kinds != _KINDS:
        return None
    others = np.array(
        [
            *(first.d, first.alpha),
            *(second.theta + first.theta - math.pi / 2, second.d, second.alpha - math.pi / 2),
            *(third.theta, third.a, third.alpha),
        ]
    )
    g = float(np.linalg.norm(gravity))
    up, frame = -gravity / g, base.matrix
    for joint in before:
        axis = frame[:3, :3] @ joint.before[:3, :3] @ joint.direction
        if joint.kind != "revolute" or abs(axis @ up) < 1.0 - _CLOSE:
            return None
        frame = frame @ joint.transform(np.zeros(1))[0]
    if np.abs(others).max() > _CLOSE or np.abs(frame[:3, 1] - up).max() > _CLOSE:
        return None
    return PlanarCrane(
        joints=(inner.name, outer.name, telescope.name),
        base_height=float(up @ frame[:3, 3]),
        theta_2_0=first.theta,
        inner_boom_length=first.a,
        telescope_offset=second.a,
        telescope_length=third.d,
        gravity=g,
    )
