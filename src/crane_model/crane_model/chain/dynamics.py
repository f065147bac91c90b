"""Where the bodies of a serial chain are, M, C q', G (6), and its motion under forces.

`bodies` (m, 10) holds the parameters of `crane_model.chain.body_regressor`, a row a body.
Functions named `set_...` serve one sample, (j,) arrays, and can be called from a compiled
simulation.
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
    chain: SerialChain,
    bodies: Array,
    q: Array,
    v: Array,
    a: Array,
    moving: BodyMotion,
    out: Array,
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


@njit(cache=True)
def _add_carried(body: Array, r: Array, i: int, p: Vector, out: Array) -> None:
    """Add to `out` (10,) a body whose frame is turned by r[i] and lies at p: Steiner."""
    m = body[0]
    h = turned(r, i, (body[1], body[2], body[3]))
    out[0] += m
    for c in range(3):
        out[1 + c] += h[c] + m * p[c]
    twice = 2.0 * dot(p, h) + m * dot(p, p)
    place = 4
    for b in range(3):  # columns of R I R^T, from its upper triangle
        column = turned(r, i, inertia_times(body, (r[i, b, 0], r[i, b, 1], r[i, b, 2])))
        for c in range(b + 1):
            out[place] += column[c] - p[c] * h[b] - h[c] * p[b] - m * p[c] * p[b]
            if c == b:
                out[place] += twice
            place += 1


@njit(cache=True)
def set_mass_matrix(
    chain: SerialChain, bodies: Array, q: Array, moving: BodyMotion, out: Array
) -> None:
    """M(q) of one sample into `out` (j, j): composite rigid bodies, Walker and Orin (1982)."""
    set_frames(chain, q, moving.rotation, moving.origin)
    r = moving.rotation
    out[:] = 0.0
    composite = np.zeros((2, 10))  # of the bodies from i on, and from i + 1 on
    for i in range(len(bodies) - 1, -1, -1):
        here, ahead = composite[i % 2], composite[(i + 1) % 2]
        for c in range(10):
            here[c] = bodies[i, c]
        if i + 1 < len(bodies):
            _add_carried(ahead, r, i + 1, row(moving.origin, i + 1), here)
        axis = scaled(chain.ratio[i], row(chain.axis, i))
        h = (here[1], here[2], here[3])
        if chain.slides[i]:
            force, moment = scaled(here[0], axis), cross(h, axis)
        else:
            force, moment = cross(axis, h), inertia_times(here, axis)
        row_i = chain.leader[i]
        for k in range(i, -1, -1):
            axis = row(chain.axis, k)
            asked = dot(axis, force) if chain.slides[k] else dot(axis, moment)
            column = chain.leader[k]
            out[row_i, column] += chain.ratio[k] * asked
            if k != i:
                out[column, row_i] += chain.ratio[k] * asked
            force = turned(r, k, force)
            moment = add(turned(r, k, moment), cross(row(moving.origin, k), force))


@njit(cache=True)
def solve(matrix: Array, load: Array) -> bool:
    """Solve M x = load (j,) in place by M = L L^T; False if M (j, j) is not positive definite.

    L is left below the diagonal of `matrix`.
    """
    n = len(load)
    for i in range(n):
        for j in range(i + 1):
            rest = matrix[i, j]
            for k in range(j):
                rest -= matrix[i, k] * matrix[j, k]
            if i != j:
                matrix[i, j] = rest / matrix[j, j]
            elif rest > 0.0:
                matrix[i, i] = math.sqrt(rest)
            else:
                return False
        for k in range(i):
            load[i] -= matrix[i, k] * load[k]
        load[i] /= matrix[i, i]
    for i in range(n - 1, -1, -1):
        for k in range(i + 1, n):
            load[i] -= matrix[k, i] * load[k]
        load[i] /= matrix[i, i]
    return True


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


def coriolis_forces(chain: SerialChain, bodies: Array, q: Array, v: Array) -> Array:
    """C(q, q') q' of (6): (n, j) coordinates and velocities to (n, j)."""
    weightless = chain._replace(gravity=np.zeros(3))
    return inverse_dynamics(weightless, bodies, q, v, np.zeros_like(q, dtype=float))


def mass_matrices(chain: SerialChain, bodies: Array, q: Array) -> Array:
    """M(q) of (6): (n, j) coordinates to (n, j, j)."""
    return _mass_matrices(chain, bodies, np.ascontiguousarray(q, dtype=float))


@njit(cache=True)
def _mass_matrices(chain: SerialChain, bodies: Array, q: Array) -> Array:
    n, j = q.shape
    out, moving = np.empty((n, j, j)), workspace(len(bodies))
    for k in range(n):
        set_mass_matrix(chain, bodies, q[k], moving, out[k])
    return out


@njit(cache=True)
def set_acceleration(
    chain: SerialChain,
    bodies: Array,
    q: Array,
    v: Array,
    moving: BodyMotion,
    mass: Array,
    force: Array,
) -> bool:
    """q'' of one sample, in the place of the `force` (j,) on the joints that causes it.

    `moving` and `mass` (j, j) are workspaces. False if M is not positive definite.
    """
    bias = np.empty_like(force)
    set_forces(chain, bodies, q, v, np.zeros_like(v), moving, bias)
    force -= bias
    set_mass_matrix(chain, bodies, q, moving, mass)
    return solve(mass, force)


def forward_dynamics(chain: SerialChain, bodies: Array, q: Array, v: Array, force: Array) -> Array:
    """q'' under forces on the joints, (n, j) each; nan where M is not positive definite."""
    q, v, force = (np.array(values, dtype=float) for values in (q, v, force))
    _accelerate(chain, bodies, q, v, force)
    return force


@njit(cache=True)
def _accelerate(chain: SerialChain, bodies: Array, q: Array, v: Array, force: Array) -> None:
    moving, mass = workspace(len(bodies)), np.empty((q.shape[1], q.shape[1]))
    for n in range(len(q)):
        if not set_acceleration(chain, bodies, q[n], v[n], moving, mass, force[n]):
            force[n] = np.nan


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
