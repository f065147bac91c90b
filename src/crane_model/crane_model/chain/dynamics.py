"""Forces of a serial chain by its motion (6): recursively, compiled.

`bodies` (m, 10) holds the parameters of `crane_model.chain.body_regressor`, a row a body. Functions
named `set_...` serve one sample, (j,) arrays, and can be called from a compiled simulation.
"""

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from crane_model.array import Array
from crane_model.chain import SerialChain

# Vectors of three numbers as tuples, which compiled code keeps in registers.

Vector = tuple[float, float, float]
ZERO = (0.0, 0.0, 0.0)


@njit(cache=True)
def row(matrix: Array, i: int) -> Vector:
    """Row i of an (n, 3) array."""
    return matrix[i, 0], matrix[i, 1], matrix[i, 2]


@njit(cache=True)
def put(matrix: Array, i: int, a: Vector) -> None:
    """Fill row i of an (n, 3) array; assigning whole rows makes numba compile for seconds."""
    matrix[i, 0], matrix[i, 1], matrix[i, 2] = a


@njit(cache=True)
def add(a: Vector, b: Vector) -> Vector:
    """a + b."""
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


@njit(cache=True)
def scaled(factor: float, a: Vector) -> Vector:
    """factor a."""
    return factor * a[0], factor * a[1], factor * a[2]


@njit(cache=True)
def dot(a: Vector, b: Vector) -> float:
    """a . b."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@njit(cache=True)
def cross(a: Vector, b: Vector) -> Vector:
    """a x b."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@njit(cache=True)
def turned(r: Array, i: int, a: Vector) -> Vector:
    """R_i a of rotations (m, 3, 3)."""
    return (
        r[i, 0, 0] * a[0] + r[i, 0, 1] * a[1] + r[i, 0, 2] * a[2],
        r[i, 1, 0] * a[0] + r[i, 1, 1] * a[1] + r[i, 1, 2] * a[2],
        r[i, 2, 0] * a[0] + r[i, 2, 1] * a[1] + r[i, 2, 2] * a[2],
    )


@njit(cache=True)
def turned_back(r: Array, i: int, a: Vector) -> Vector:
    """R_i^T a of rotations (m, 3, 3)."""
    return (
        r[i, 0, 0] * a[0] + r[i, 1, 0] * a[1] + r[i, 2, 0] * a[2],
        r[i, 0, 1] * a[0] + r[i, 1, 1] * a[1] + r[i, 2, 1] * a[2],
        r[i, 0, 2] * a[0] + r[i, 1, 2] * a[1] + r[i, 2, 2] * a[2],
    )


@njit(cache=True)
def set_turn(fixed: Array, axis: Vector, angle: float, out: Array) -> None:
    """`fixed` (3, 3), then a turn by `angle` about the unit `axis` (Rodrigues), into `out`."""
    x, y, z = axis
    sin, cos = math.sin(angle), math.cos(angle)
    rest = 1.0 - cos
    xy, xz, yz = rest * x * y, rest * x * z, rest * y * z
    first = cos + rest * x * x, xy - sin * z, xz + sin * y
    second = xy + sin * z, cos + rest * y * y, yz - sin * x
    third = xz - sin * y, yz + sin * x, cos + rest * z * z
    for i in range(3):
        a, b, c = fixed[i, 0], fixed[i, 1], fixed[i, 2]
        out[i, 0] = a * first[0] + b * second[0] + c * third[0]
        out[i, 1] = a * first[1] + b * second[1] + c * third[1]
        out[i, 2] = a * first[2] + b * second[2] + c * third[2]


# Motion and forces of the bodies of a chain.


@njit(cache=True)
def set_frames(chain: SerialChain, q: Array, rotation: Array, origin: Array) -> None:
    """Fill the pose of each body in the frame of its predecessor at q (j,): (m, 3, 3), (m, 3)."""
    for i in range(len(chain.ratio)):
        moved = chain.ratio[i] * q[chain.leader[i]]
        axis = row(chain.axis, i)
        place = row(chain.translation, i)
        if chain.slides[i]:
            for c in range(3):
                put(rotation[i], c, row(chain.rotation[i], c))
            place = add(place, turned(chain.rotation, i, scaled(moved, axis)))
        else:
            set_turn(chain.rotation[i], axis, moved, rotation[i])
        put(origin, i, place)


class BodyMotion(NamedTuple):
    """Motion of m bodies, each in its own frame; a workspace that compiled code fills."""

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


@njit(cache=True)
def inertia_times(body: Array, a: Vector) -> Vector:
    """I a, with I_xx, I_xy, I_yy, I_xz, I_yz, I_zz in their places among the ten."""
    return (
        body[4] * a[0] + body[5] * a[1] + body[7] * a[2],
        body[5] * a[0] + body[6] * a[1] + body[8] * a[2],
        body[7] * a[0] + body[8] * a[1] + body[9] * a[2],
    )


@njit(cache=True)
def set_forces(
    chain: SerialChain, bodies: Array, q: Array, v: Array, a: Array, moving: BodyMotion, out: Array
) -> None:
    """tau (6) of one sample into `out` (j,), recursively: Newton and Euler."""
    set_motion(chain, q, v, a, moving)
    out[:] = 0.0
    force, moment = ZERO, ZERO
    for i in range(len(bodies) - 1, -1, -1):
        body = bodies[i]
        h = (body[1], body[2], body[3])
        w, turning, rise = row(moving.spin, i), row(moving.turning, i), row(moving.rise, i)
        demand = add(add(scaled(body[0], rise), cross(turning, h)), cross(w, cross(w, h)))
        force = add(force, demand)
        gyroscopic = cross(w, inertia_times(body, w))
        demand = add(cross(h, rise), add(inertia_times(body, turning), gyroscopic))
        moment = add(moment, demand)
        axis = row(chain.axis, i)
        asked = dot(axis, force) if chain.slides[i] else dot(axis, moment)
        out[chain.leader[i]] += chain.ratio[i] * asked
        force = turned(moving.rotation, i, force)
        moment = add(turned(moving.rotation, i, moment), cross(row(moving.origin, i), force))


def inverse_dynamics(chain: SerialChain, bodies: Array, q: Array, v: Array, a: Array) -> Array:
    """tau (6): (n, j) motion to (n, j) [N m, N]."""
    q, v, a = (np.ascontiguousarray(motion, dtype=float) for motion in (q, v, a))
    return _inverse_dynamics(chain, bodies, q, v, a)


@njit(cache=True)
def _inverse_dynamics(chain: SerialChain, bodies: Array, q: Array, v: Array, a: Array) -> Array:
    out, moving = np.empty_like(q), workspace(len(bodies))
    for n in range(len(q)):
        set_forces(chain, bodies, q[n], v[n], a[n], moving, out[n])
    return out


def gravity_forces(chain: SerialChain, bodies: Array, q: Array) -> Array:
    """G(q) of (6): (n, j) coordinates to (n, j)."""
    still = np.zeros_like(q, dtype=float)
    return inverse_dynamics(chain, bodies, q, still, still)


# Loads at the tip as bodies of the chain: see `crane_model.chain.dynamics` for the ten numbers.


def tip_bodies(chain: SerialChain) -> Array:
    """(2, m, 10): 1 kg at the tip; 1 kg m about it, along the line from the last joint to the tip.

    A load m whose centre lies c beyond the tip is m times the first and m c times the second.
    """
    tip = chain.tip_translation
    reach = float(np.linalg.norm(tip))
    along = tip / reach if reach else chain.axis[-1]
    bodies = np.zeros((2, len(chain.axis), 10))
    bodies[0, -1] = _body(1.0, tip, np.outer(tip, tip))
    bodies[1, -1] = _body(0.0, along, np.outer(tip, along) + np.outer(along, tip))
    return bodies


def _body(mass: float, moment: Array, second: Array) -> Array:
    """(10,) from the mass, the first moment (3,) and the second (3, 3) about the link's origin."""
    inertia = np.trace(second) * np.eye(3) - second
    return np.array(
        [mass, *moment, inertia[0, 0], inertia[0, 1], inertia[1, 1], inertia[0, 2], inertia[1, 2],
         inertia[2, 2]]
    )  # fmt: skip
