"""Vectors of three numbers as tuples, which compiled code keeps in registers."""

import math

from numba import njit

from crane_model.array import Array

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
