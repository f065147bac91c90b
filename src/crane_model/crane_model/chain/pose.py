"""Vectors of space, and where the bodies of a chain and its tip are, compiled."""

import math

import numpy as np
from numba import njit

from crane_model.array import Array
from crane_model.chain.serial_chain import SerialChain

# Vectors of three numbers as tuples, which compiled code keeps in registers.

Vector = tuple[float, float, float]
ZERO = (0.0, 0.0, 0.0)


@njit(cache=True)
def row(matrix: Array, i: int) -> Vector:
    """Row i of an (n, 3) array."""
    return matrix[i, 0], matrix[i, 1], matrix[i, 2]


@njit(cache=True)
def put(matrix: Array, i: int, a: Vector) -> None:
    """Fill row i of an (n, 3) array, number by number: where a row is assigned as a whole, numba
    first compiles for seconds what raises an error for a wrong shape.
    """
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


# Where the bodies of a chain are, and its tip: compiled, vectorised over samples.


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


@njit(cache=True)
def body_frames(chain: SerialChain, q: Array) -> tuple[Array, Array]:
    """(n, j) coordinates to rotations (n, m, 3, 3) and origins (n, m, 3) in the base's frame."""
    n, m = len(q), len(chain.ratio)
    rotations, origins = np.empty((n, m, 3, 3)), np.empty((n, m, 3))
    rotation, origin = np.empty((m, 3, 3)), np.empty((m, 3))
    for k in range(n):
        set_frames(chain, q[k], rotation, origin)
        put(origins[k], 0, row(origin, 0))
        for c in range(3):
            put(rotations[k, 0], c, row(rotation[0], c))
        for i in range(1, m):
            for a in range(3):
                for b in range(3):
                    rotations[k, i, a, b] = (
                        rotations[k, i - 1, a, 0] * rotation[i, 0, b]
                        + rotations[k, i - 1, a, 1] * rotation[i, 1, b]
                        + rotations[k, i - 1, a, 2] * rotation[i, 2, b]
                    )
            place = turned(rotations[k], i - 1, row(origin, i))
            put(origins[k], i, add(row(origins[k], i - 1), place))
    return rotations, origins


def tip_positions(chain: SerialChain, q: Array) -> Array:
    """(n, j) coordinates to (n, 3) [m]."""
    rotations, origins = body_frames(chain, np.ascontiguousarray(q, dtype=float))
    tips: Array = origins[:, -1] + rotations[:, -1] @ chain.tip_translation
    return tips


def tip_jacobians(chain: SerialChain, q: Array) -> Array:
    """(n, j) coordinates to (n, 6, j): velocity of the tip, then its turning, in the base's frame
    for a unit velocity of each joint.
    """
    q = np.ascontiguousarray(q, dtype=float)
    rotations, origins = body_frames(chain, q)
    tips = origins[:, -1] + rotations[:, -1] @ chain.tip_translation
    jacobians = np.zeros((len(q), 6, q.shape[1]))
    _add_twists(chain, rotations, origins, tips, jacobians)
    return jacobians


@njit(cache=True)
def _add_twists(
    chain: SerialChain, rotations: Array, origins: Array, tips: Array, out: Array
) -> None:
    for k in range(len(tips)):
        tip = row(tips, k)
        for i in range(len(chain.ratio)):
            j, ratio = chain.leader[i], chain.ratio[i]
            axis = scaled(ratio, turned(rotations[k], i, row(chain.axis, i)))
            if chain.slides[i]:
                for c in range(3):
                    out[k, c, j] += axis[c]
            else:
                arm = add(tip, scaled(-1.0, row(origins[k], i)))
                along = cross(axis, arm)
                for c in range(3):
                    out[k, c, j] += along[c]
                    out[k, 3 + c, j] += axis[c]
