"""Rigid-body dynamics of any serial chain, from the full parameters of its bodies.

Everything is kept in the axes of the base and about its origin: where a pose has carried the axes
of the joints, what a link weighs there, how it moves. So inertias simply add up, what a link needs
follows from its momentum, and no frame of a link is ever needed. There is no regressor and there
are no base parameters: the identification is judged against this code, so it shares none with it.

A twist is (turning rate, velocity of the point that passes the origin of the base).
"""

import math
from typing import NamedTuple

import numpy as np
from numba import njit

# Vectors of space in compiled code: tuples of three numbers, which stay in registers.

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


LINK = np.dtype(
    [
        # in the zero pose
        ("axis", float, 3),  # unit vector, about or along which its joint moves it
        ("point", float, 3),  # on that axis, m
        ("slides", bool),
        ("leader", int),  # the coordinate q that moves the joint,
        ("ratio", float),  # by so much of it
        ("mass", float),  # kg
        ("centre", float, 3),  # of mass, m
        ("inertia", float, (3, 3)),  # about the centre of mass, kg m2
        # as `place` has carried it
        ("rotation", float, (3, 3)),  # out of the zero pose
        ("shift", float, 3),  # with it, m
        ("turn", float, 3),  # twist at a unit rate of the coordinate: turning,
        ("slide", float, 3),  # and velocity at the origin
        # by `mass_and_bias`: of it and all links beyond, about the origin
        ("carried", float),  # kg
        ("moment", float, 3),  # kg m
        ("about_origin", float, (3, 3)),  # inertia, kg m2
        ("torque", float, 3),  # N m, without acceleration of the joints
        ("force", float, 3),  # N
    ]
)


class Chain(NamedTuple):
    """A serial chain of m links that j coordinates move."""

    links: np.ndarray  # (m + 1,) records, fields LINK; the first is the base
    tip: np.ndarray  # (3,) in the zero pose, m
    outward: np.ndarray  # (3,) unit vector, along which the last link reaches out at its tip
    gravity: np.ndarray  # (3,) m/s2


@njit(cache=True, error_model="numpy")
def place(chain: Chain, q: np.ndarray) -> None:
    """Carry axes and links to the pose q (j,): the product of exponentials."""
    for i in range(1, len(chain.links)):
        before, link = chain.links[i - 1], chain.links[i]
        moved, ratio = link.ratio * q[link.leader], link.ratio
        direction = product(before.rotation, vector(link.axis))
        if link.slides:
            for a in range(3):
                for b in range(3):
                    link.rotation[a, b] = before.rotation[a, b]
            put(link.shift, summed(vector(before.shift), scaled(moved, direction)))
            put(link.turn, (0.0, 0.0, 0.0))
            put(link.slide, scaled(ratio, direction))
        else:
            point = vector(link.point)
            at = carried(before, point)
            _turn_about(direction, moved, before.rotation, link.rotation)
            put(link.shift, summed(at, scaled(-1.0, product(link.rotation, point))))
            put(link.turn, scaled(ratio, direction))
            put(link.slide, scaled(ratio, cross(at, direction)))


@njit(cache=True, error_model="numpy")
def mass_and_bias(
    chain: Chain, q: np.ndarray, v: np.ndarray, mass: np.ndarray, bias: np.ndarray
) -> None:
    """Fill M(q) (j, j) and the bias C(q, v) v + G(q) (j,) of (6)."""
    place(chain, q)
    links = chain.links
    omega, velocity, alpha = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    acceleration = scaled(-1.0, vector(chain.gravity))  # of a base held against gravity
    for i in range(1, len(links)):
        link = links[i]
        rate, turn, slide = v[link.leader], vector(link.turn), vector(link.slide)
        # the axis moves with the link before: what its rate adds to the acceleration
        alpha = add_cross(alpha, scaled(rate, omega), turn)
        acceleration = add_cross(acceleration, scaled(rate, omega), slide)
        acceleration = add_cross(acceleration, scaled(rate, velocity), turn)
        omega = summed(omega, scaled(rate, turn))
        velocity = summed(velocity, scaled(rate, slide))
        m, centre = link.mass, carried(link, vector(link.centre))
        moment = scaled(m, centre)
        _place_inertia(link, moment, centre)
        link.carried = m
        put(link.moment, moment)
        momentum = add_cross(scaled(m, velocity), omega, moment)
        spin = add_cross(product(link.about_origin, omega), moment, velocity)
        force = add_cross(scaled(m, acceleration), alpha, moment)
        put(link.force, add_cross(force, omega, momentum))
        torque = add_cross(product(link.about_origin, alpha), moment, acceleration)
        torque = add_cross(torque, omega, spin)
        put(link.torque, add_cross(torque, velocity, momentum))
    mass[:] = 0.0
    bias[:] = 0.0
    for i in range(len(links) - 1, 0, -1):
        link = links[i]
        turn, slide, moment = vector(link.turn), vector(link.slide), vector(link.moment)
        torque, force = vector(link.torque), vector(link.force)
        bias[link.leader] += dot(turn, torque) + dot(slide, force)
        # all from this link on moves with its joint: the momentum at a unit rate
        momentum = add_cross(scaled(link.carried, slide), turn, moment)
        spin = add_cross(product(link.about_origin, turn), moment, slide)
        for k in range(1, i + 1):
            mover = links[k]
            held = dot(vector(mover.turn), spin) + dot(vector(mover.slide), momentum)
            mass[mover.leader, link.leader] += held
            if k < i:
                mass[link.leader, mover.leader] += held
        if i > 1:
            before = links[i - 1]
            before.carried += link.carried
            put(before.moment, summed(vector(before.moment), moment))
            put(before.torque, summed(vector(before.torque), torque))
            put(before.force, summed(vector(before.force), force))
            for a in range(3):
                for b in range(3):
                    before.about_origin[a, b] += link.about_origin[a, b]


@njit(cache=True, error_model="numpy")
def carried(link: np.record, point: Vector) -> Vector:
    """Position on a placed link of its point that is at `point` in the zero pose [m]."""
    return summed(product(link.rotation, point), vector(link.shift))


@njit(cache=True, error_model="numpy")
def tip_of(chain: Chain) -> Vector:
    """Position of the placed tip [m]."""
    return carried(chain.links[-1], vector(chain.tip))


@njit(cache=True, error_model="numpy")
def add_push(chain: Chain, at: Vector, force: Vector, into: np.ndarray) -> None:
    """Add to `into` (j,) the generalized forces of a force [N] on a point of the last link [m]."""
    torque = cross(at, force)
    for i in range(1, len(chain.links)):
        link = chain.links[i]
        into[link.leader] += dot(vector(link.turn), torque) + dot(vector(link.slide), force)


@njit(cache=True, error_model="numpy")
def beyond(chain: Chain, i: int) -> tuple[float, Vector]:
    """Mass [kg] of all links from record i on, and their moment about the origin as placed."""
    mass, moment = 0.0, (0.0, 0.0, 0.0)
    for k in range(i, len(chain.links)):
        link = chain.links[k]
        mass += link.mass
        moment = summed(moment, scaled(link.mass, carried(link, vector(link.centre))))
    return mass, moment


@njit(cache=True, error_model="numpy")
def _place_inertia(link: np.record, moment: Vector, centre: Vector) -> None:
    """Inertia of a link as placed, about the origin."""
    square = dot(moment, centre)
    for a in range(3):
        half = product(link.inertia, vector(link.rotation[a]))
        turned = product(link.rotation, half)
        put(link.about_origin[a], summed(turned, scaled(-moment[a], centre)))
        link.about_origin[a, a] += square


@njit(cache=True, error_model="numpy")
def _turn_about(axis: Vector, angle: float, before: np.ndarray, after: np.ndarray) -> None:
    """`before` (3, 3), turned by `angle` [rad] about a unit vector (Rodrigues), into `after`."""
    c, s = math.cos(angle), math.sin(angle)
    for b in range(3):
        column = (before[0, b], before[1, b], before[2, b])
        turned = add_cross(scaled(c, column), scaled(s, axis), column)
        turned = summed(turned, scaled((1.0 - c) * dot(axis, column), axis))
        after[0, b], after[1, b], after[2, b] = turned
