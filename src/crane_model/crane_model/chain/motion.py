"""How the bodies of a chain turn and accelerate: the outward pass of Newton and Euler."""

from typing import NamedTuple

import numpy as np
from numba import njit

from crane_model.array import Array
from crane_model.chain.pose import set_frames
from crane_model.chain.serial_chain import SerialChain
from crane_model.chain.vectors import ZERO, add, cross, put, row, scaled, turned_back


class BodyMotion(NamedTuple):
    """Of m bodies, each in its own frame; a workspace that compiled code fills."""

    rotation: Array  # (m, 3, 3) in the frame of the body before
    origin: Array  # (m, 3) in the frame of the body before
    spin: Array  # (m, 3) angular velocity
    turning: Array  # (m, 3) angular acceleration
    rise: Array  # (m, 3) acceleration of the origin less that of gravity


@njit(cache=True)
def workspace(bodies: int) -> BodyMotion:
    """For so many bodies."""
    return BodyMotion(
        np.empty((bodies, 3, 3)),
        np.empty((bodies, 3)),
        np.empty((bodies, 3)),
        np.empty((bodies, 3)),
        np.empty((bodies, 3)),
    )


@njit(cache=True)
def set_motion(chain: SerialChain, q: Array, v: Array, a: Array, out: BodyMotion) -> None:
    """The motion of all bodies at coordinates, velocities and accelerations (j,) each.

    Luh, Walker and Paul (1980), in the frames of the bodies.
    """
    set_frames(chain, q, out.rotation, out.origin)
    w, turning = ZERO, ZERO
    rise = (-chain.gravity[0], -chain.gravity[1], -chain.gravity[2])
    for i in range(len(chain.ratio)):
        j, ratio = chain.leader[i], chain.ratio[i]
        p, axis = row(out.origin, i), row(chain.axis, i)
        speed, push = scaled(ratio * v[j], axis), scaled(ratio * a[j], axis)
        carried = add(rise, add(cross(turning, p), cross(w, cross(w, p))))
        w = turned_back(out.rotation, i, w)
        turning = turned_back(out.rotation, i, turning)
        rise = turned_back(out.rotation, i, carried)
        if chain.slides[i]:
            rise = add(rise, add(push, scaled(2.0, cross(w, speed))))
        else:
            turning = add(turning, add(push, cross(w, speed)))
            w = add(w, speed)
        put(out.spin, i, w)
        put(out.turning, i, turning)
        put(out.rise, i, rise)
