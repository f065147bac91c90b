"""Derivatives of the regressor of `crane_model.chain.body_regressor` with respect to the motion,
summed with weights: one pass outward and one back for all joints (reverse differentiation).
"""

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from crane_model.array import Array
from crane_model.chain import SerialChain
from crane_model.chain.dynamics import (
    ZERO,
    BodyMotion,
    Vector,
    add,
    cross,
    dot,
    inertia_times,
    put,
    row,
    scaled,
    set_motion,
    turned,
    turned_back,
    workspace,
)


class Slopes(NamedTuple):
    """With respect to the motion of the body at hand."""

    spin: Vector
    turning: Vector
    rise: Vector


def pull_back(
    chain: SerialChain,
    rows: NDArray[np.int64],
    parameters: NDArray[np.int64],
    q: Array,
    v: Array,
    acceleration: Array,
    weight: Array,
) -> Array:
    """(3, n, j): derivatives with respect to q, q', q'' (n, j) of sum_rc weight_nrc Y_nrc.

    `weight` (n, rows, columns) belongs to the columns that `fill_regressor` writes for the same
    `rows` and `parameters`.
    """
    q, v, a = (np.ascontiguousarray(motion, dtype=float) for motion in (q, v, acceleration))
    out = np.zeros((3, *q.shape))
    of_bodies = np.zeros((len(chain.ratio), 10 * len(chain.ratio)))  # of one sample, a row a joint
    _pull_back(chain, rows, parameters, q, v, a, np.ascontiguousarray(weight), of_bodies, out)
    return out


@njit(cache=True)
def _pull_back(
    chain: SerialChain,
    rows: NDArray[np.int64],
    parameters: NDArray[np.int64],
    q: Array,
    v: Array,
    a: Array,
    weight: Array,
    of_bodies: Array,
    out: Array,
) -> None:
    m = len(chain.ratio)
    moving = workspace(m)
    along, about = np.empty((m, m, 3)), np.empty((m, m, 3))
    for n in range(len(q)):
        for k in range(m):
            if rows[k] >= 0:
                for c in range(len(parameters)):
                    of_bodies[k, parameters[c]] = weight[n, rows[k], c]
        set_motion(chain, q[n], v[n], a[n], moving)
        _set_twists(chain, moving, along, about)
        _come_back(chain, moving, along, about, of_bodies, n, v, a, out)


@njit(cache=True)
def _set_twists(chain: SerialChain, moving: BodyMotion, along: Array, about: Array) -> None:
    """Unit twist of each joint k at each body i from its own on, into (i, k, 3)."""
    for i in range(len(chain.ratio)):
        unit = scaled(chain.ratio[i], row(chain.axis, i))
        put(along[i], i, unit if chain.slides[i] else ZERO)
        put(about[i], i, ZERO if chain.slides[i] else unit)
        for k in range(i):
            turn = row(about[i - 1], k)
            shift = add(row(along[i - 1], k), cross(turn, row(moving.origin, i)))
            put(along[i], k, turned_back(moving.rotation, i, shift))
            put(about[i], k, turned_back(moving.rotation, i, turn))


@njit(cache=True)
def _come_back(
    chain: SerialChain,
    moving: BodyMotion,
    along: Array,
    about: Array,
    of_bodies: Array,
    n: int,
    v: Array,
    a: Array,
    out: Array,
) -> None:
    """From the last body to the first: slopes by motion and twists, carried to the body before."""
    m = len(chain.ratio)
    by_along, by_about = np.zeros((m, 3)), np.zeros((m, 3))
    by_spin, by_turning, by_rise = ZERO, ZERO, ZERO
    r = moving.rotation
    for i in range(m - 1, -1, -1):
        w, turning, rise = row(moving.spin, i), row(moving.turning, i), row(moving.rise, i)
        for k in range(i + 1):
            ten = of_bodies[k, 10 * i : 10 * i + 10]
            here = row(along[i], k), row(about[i], k)
            slopes, at_along, at_about = _of_power(ten, *here, w, turning, rise)
            by_spin = add(by_spin, slopes.spin)
            by_turning = add(by_turning, slopes.turning)
            by_rise = add(by_rise, slopes.rise)
            put(by_along, k, add(row(by_along, k), at_along))
            put(by_about, k, add(row(by_about, k), at_about))

        # the joint's own speed and push; w, turning and rise become those before it moved
        j, ratio, axis = chain.leader[i], chain.ratio[i], row(chain.axis, i)
        speed, push = scaled(ratio * v[n, j], axis), scaled(ratio * a[n, j], axis)
        if chain.slides[i]:
            out[2, n, j] += ratio * dot(by_rise, axis)
            out[1, n, j] += ratio * 2.0 * dot(by_rise, cross(w, axis))
            rise = add(rise, scaled(-1.0, add(push, scaled(2.0, cross(w, speed)))))
            by_spin = add(by_spin, scaled(2.0, cross(speed, by_rise)))
        else:
            w = add(w, scaled(-1.0, speed))
            out[2, n, j] += ratio * dot(by_turning, axis)
            out[1, n, j] += ratio * (dot(by_turning, cross(w, axis)) + dot(by_spin, axis))
            turning = add(turning, scaled(-1.0, add(push, cross(w, speed))))
            by_spin = add(by_spin, cross(speed, by_turning))

        # all that was turned into the frame of the body: by its angle, then back
        bent = add(cross(w, by_spin), add(cross(turning, by_turning), cross(rise, by_rise)))
        for k in range(i):
            bent = add(bent, cross(row(along[i], k), row(by_along, k)))
            bent = add(bent, cross(row(about[i], k), row(by_about, k)))
        if not chain.slides[i]:
            out[0, n, j] -= ratio * dot(axis, bent)
        p = row(moving.origin, i)
        by_spin, by_turning, by_rise = (
            turned(r, i, by_spin),
            turned(r, i, by_turning),
            turned(r, i, by_rise),
        )
        w, turning = turned(r, i, w), turned(r, i, turning)
        by_origin = add(cross(by_rise, turning), cross(w, cross(w, by_rise)))
        by_turning = add(by_turning, cross(p, by_rise))
        outward = add(scaled(dot(w, p), by_rise), scaled(dot(by_rise, w), p))
        by_spin = add(by_spin, add(outward, scaled(-2.0 * dot(by_rise, p), w)))
        for k in range(i):
            shift, turn = turned(r, i, row(by_along, k)), turned(r, i, row(by_about, k))
            put(by_along, k, shift)
            put(by_about, k, add(turn, cross(p, shift)))
            by_origin = add(by_origin, cross(shift, row(about[i - 1], k)))
        if chain.slides[i]:
            out[0, n, j] += ratio * dot(turned(r, i, axis), by_origin)


@njit(cache=True)
def _of_power(
    ten: Array, along: Vector, about: Vector, w: Vector, turning: Vector, rise: Vector
) -> tuple[Slopes, Vector, Vector]:
    """Slopes of what ten parameters ask of a twist at a body, with respect to the body's motion
    and to the twist: of m along . a + h . (along x al + (along . w) w - (w . w) along + a x about)
    + about . I al + (about x w) . I w.
    """
    h = (ten[1], ten[2], ten[3])
    around = cross(about, w)
    inertia_w = inertia_times(ten, w)
    by_spin = add(scaled(dot(along, w), h), scaled(dot(h, w), along))
    by_spin = add(by_spin, scaled(-2.0 * dot(h, along), w))
    by_spin = add(by_spin, add(cross(inertia_w, about), inertia_times(ten, around)))
    by_turning = add(cross(h, along), inertia_times(ten, about))
    by_rise = add(scaled(ten[0], along), cross(about, h))
    by_along = add(scaled(ten[0], rise), cross(turning, h))
    by_along = add(by_along, add(scaled(dot(h, w), w), scaled(-dot(w, w), h)))
    by_about = add(cross(h, rise), add(inertia_times(ten, turning), cross(w, inertia_w)))
    return Slopes(by_spin, by_turning, by_rise), by_along, by_about
