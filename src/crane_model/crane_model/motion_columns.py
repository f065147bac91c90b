"""Regressor columns that are proportional to what one joint does at an instant, compiled.

Friction (13) is made of such columns; inertias, rotors and constant forces are others. Regressor,
excitation design and controllers take them from here, each in one pass over all of a model.
"""

import math
from collections.abc import Sequence
from enum import IntEnum
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from crane_model.array import Array
from crane_model.record import Record, column_of

BLOCK_SAMPLES = 16  # their part of a regressor fits the fastest memory


class MotionQuantity(IntEnum):
    """Motion of a joint at an instant."""

    ONE = 0  # whatever it does
    DIRECTION = 1  # sgn(q')
    VELOCITY = 2  # q'
    SPEED = 3  # |q'|; where sgn is smooth, q' sgn(q')
    ACCELERATION = 4  # q''


class MotionColumn(NamedTuple):
    """Entry on the row of a joint in the column of a parameter."""

    row: str  # joint
    parameter: int
    quantity: MotionQuantity
    joint: str  # whose motion it is
    factor: float = 1.0


class ColumnTable(NamedTuple):
    """c columns for compiled code; unsigned numbers, so that no index counts from the end."""

    rows: NDArray[np.uint64]  # (c,)
    parameters: NDArray[np.uint64]
    places: NDArray[np.uint64]  # in the quantities of an instant
    factors: Array


@lru_cache(maxsize=256)
def table(columns: tuple[MotionColumn, ...], joints: tuple[str, ...]) -> ColumnTable:
    """For samples of these joints; `DataError` if one is missing."""
    at = [column_of(joints, column.joint) for column in columns]
    places = [column.quantity * len(joints) + j for column, j in zip(columns, at, strict=True)]
    return ColumnTable(
        np.array([column_of(joints, column.row) for column in columns], np.uint64),
        np.array([column.parameter for column in columns], np.uint64),
        np.array(places, np.uint64),
        np.array([column.factor for column in columns], float),
    )


@njit(cache=True)
def _set_quantities(v: Array, a: Array, direction: Array, smooth: bool, out: Array) -> None:
    """Those of samples (n, j) into `out` (5 j, n at least), in the order of `MotionQuantity`."""
    samples, j = v.shape
    for i in range(j):
        for n in range(samples):
            out[i, n] = 1.0
            out[j + i, n] = direction[n, i]
            out[2 * j + i, n] = v[n, i]
            out[3 * j + i, n] = v[n, i] * direction[n, i] if smooth else abs(v[n, i])
            out[4 * j + i, n] = a[n, i]


def fill(
    columns: tuple[MotionColumn, ...], record: Record, out: Array, smooth: bool = False
) -> None:
    """Add the columns to `out` (n, j, p); `smooth`: in q', where the record's direction is."""
    motion = record.velocity, record.acceleration, record.direction
    v, a, direction = (np.ascontiguousarray(values, dtype=float) for values in motion)
    _fill(table(columns, record.joints), v, a, direction, smooth, out)


@njit(cache=True)
def _fill(
    table: ColumnTable, v: Array, a: Array, direction: Array, smooth: bool, out: Array
) -> None:
    quantities = np.empty((5 * v.shape[1], BLOCK_SAMPLES))
    for begin in range(0, len(v), BLOCK_SAMPLES):
        some = slice(begin, min(begin + BLOCK_SAMPLES, len(v)))
        _set_quantities(v[some], a[some], direction[some], smooth, quantities)
        for c in range(len(table.factors)):
            factor, values = table.factors[c], quantities[table.places[c]]
            column = out[some, table.rows[c], table.parameters[c]]
            for n in range(len(column)):
                column[n] += factor * values[n]


def pull_back(
    columns: Sequence[MotionColumn], record: Record, steepness: Array, weight: Array, slopes: Array
) -> None:
    """Add to `slopes` (3, n, j) the derivatives with respect to q, q', q'' of their smooth sum
    with weights (n, j, p); `steepness` (n, j) is that of the record's direction over q'.
    """
    _, by_velocity, by_acceleration = slopes
    for column in columns:
        j = record.column(column.joint)
        given = weight[:, record.column(column.row), column.parameter] * column.factor
        match column.quantity:
            case MotionQuantity.DIRECTION:
                by_velocity[:, j] += given * steepness[:, j]
            case MotionQuantity.VELOCITY:
                by_velocity[:, j] += given
            case MotionQuantity.SPEED:
                slope = record.direction[:, j] + record.velocity[:, j] * steepness[:, j]
                by_velocity[:, j] += given * slope
            case MotionQuantity.ACCELERATION:
                by_acceleration[:, j] += given


@njit(cache=True)
def smooth_forces(
    table: ColumnTable, theta: Array, v: Array, a: Array, width: float, out: Array
) -> None:
    """Set `out` (1, j) to the forces of an instant, with tanh(q' / width) for sgn(q')."""
    direction, quantities = np.empty_like(v), np.empty((5 * v.shape[1], 1))
    for i in range(v.shape[1]):
        direction[0, i] = math.tanh(v[0, i] / width)
    _set_quantities(v, a, direction, True, quantities)
    out[:] = 0.0
    for c in range(len(table.factors)):
        value = table.factors[c] * quantities[table.places[c], 0]
        out[0, table.rows[c]] += theta[table.parameters[c]] * value
