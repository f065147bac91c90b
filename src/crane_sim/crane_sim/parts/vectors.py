"""Vectors of space in compiled code: tuples of three numbers, which stay in registers."""

import numpy as np
from numba import njit

Vector = tuple[float, float, float]


@njit(cache=True, error_model="numpy")
def vector(row: np.ndarray) -> Vector:
    """(3,) as a vector."""
    return row[0], row[1], row[2]


@njit(cache=True, error_model="numpy")
def put(row: np.ndarray, a: Vector) -> None:
    """Fill a row (3,)."""
    row[0], row[1], row[2] = a


@njit(cache=True, error_model="numpy")
def dot(a: Vector, b: Vector) -> float:
    """a . b"""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@njit(cache=True, error_model="numpy")
def cross(a: Vector, b: Vector) -> Vector:
    """a x b"""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@njit(cache=True, error_model="numpy")
def summed(a: Vector, b: Vector) -> Vector:
    """a + b"""
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


@njit(cache=True, error_model="numpy")
def scaled(factor: float, a: Vector) -> Vector:
    """factor a"""
    return factor * a[0], factor * a[1], factor * a[2]


@njit(cache=True, error_model="numpy")
def add_cross(total: Vector, a: Vector, b: Vector) -> Vector:
    """total + a x b"""
    return summed(total, cross(a, b))


@njit(cache=True, error_model="numpy")
def product(matrix: np.ndarray, a: Vector) -> Vector:
    """matrix (3, 3) a"""
    return (
        matrix[0, 0] * a[0] + matrix[0, 1] * a[1] + matrix[0, 2] * a[2],
        matrix[1, 0] * a[0] + matrix[1, 1] * a[1] + matrix[1, 2] * a[2],
        matrix[2, 0] * a[0] + matrix[2, 1] * a[1] + matrix[2, 2] * a[2],
    )
