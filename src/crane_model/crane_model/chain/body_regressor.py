"""The regressor of inverse dynamics (8) of a serial chain, ten parameters a body, compiled.

tau = Y(q, q', q'') p with p = (m, m c_x, m c_y, m c_z, I_xx, I_xy, I_yy, I_xz, I_yz, I_zz) of each
body in its own frame, inertias about that frame's origin: order and meaning of
`pinocchio.Inertia.toDynamicParameters`. Atkeson, An and Hollerbach (1986).

A body can have these ten exactly if its pseudo-inertia P (4, 4) is positive definite, with the
second moments Σ = tr(I) 1/2 - I (Wensing, Kim and Slotine 2018):

        | Σ        m c |
    P = |              |
        | (m c)ᵀ   m   |

Eight samples are computed at a time: every quantity of a block of samples is a row of LANES
numbers, and what is computed of them stands in loops over a row whose places are constants, so that
the compiler turns them into instructions on several samples at once. The cosines and sines of the C
library take one angle at a time; `tests/benchmarks/test_chain_speed.py` needs more.
"""

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from crane_model.array import Array
from crane_model.chain import SerialChain
from crane_model.chain.dynamics import Vector, add, cross, dot, row, scaled

LANES = 8
COS, SIN, MOVED = 43, 44, 45  # rows of the workspace: of a joint that turns; way of one that slides

FAR_ANGLE_RAD = 1e5  # from where on these digits of pi are too few
# pi/2 in three parts; the first two have so few digits that a whole number times them is exact
_HALF_PI_1, _HALF_PI_2 = 1.57079632673412561417, 6.07710050630396597660e-11
_HALF_PI_3 = 2.02226624879595063154e-21
# minimax on |x| <= pi/4: sin x = x + S3 x^3 + S5 x^5 ..., cos x = 1 - x^2 / 2 + C4 x^4 + ...
_S3, _S5, _S7 = -1.66666666666666324348e-01, 8.33333333332248946124e-03, -1.98412698298579493134e-04
_S9, _S11, _S13 = (
    2.75573137070700676789e-06,
    -2.50507602534068634195e-08,
    1.58969099521155010221e-10,
)
_C4, _C6, _C8 = 4.16666666666666019037e-02, -1.38888888888741095749e-03, 2.48015872894767294178e-05
_C10, _C12, _C14 = (
    -2.75573143513906633035e-07,
    2.08757232129817482790e-09,
    -1.13596475577881948265e-11,
)


@njit(cache=True)
def near(chain: SerialChain, q: Array) -> bool:
    """Return whether no joint turns as far as FAR_ANGLE_RAD; false if an angle is not a number."""
    for i in range(len(chain.ratio)):
        for n in range(len(q)):
            if not abs(chain.ratio[i] * q[n, chain.leader[i]]) < FAR_ANGLE_RAD:
                return False
    return True


@njit(cache=True)
def set_turn(s: Array) -> None:
    """cos and sin of the angles in `MOVED`, which become 0."""
    for lane in range(LANES):
        angle = s[MOVED * LANES + lane]
        s[COS * LANES + lane], s[SIN * LANES + lane] = math.cos(angle), math.sin(angle)
        s[MOVED * LANES + lane] = 0.0


@njit(cache=True)
def set_near_turn(s: Array) -> None:
    """The same of angles below FAR_ANGLE_RAD, several at once.

    The angle x less k quarter turns (Cody and Waite 1980), then the polynomials of FreeBSD's libm.
    """
    for lane in range(LANES):
        angle = s[MOVED * LANES + lane]
        k = math.floor(angle * (2.0 / math.pi) + 0.5)
        x = ((angle - k * _HALF_PI_1) - k * _HALF_PI_2) - k * _HALF_PI_3
        z = x * x
        sin = x + x * z * (_S3 + z * (_S5 + z * (_S7 + z * (_S9 + z * (_S11 + z * _S13)))))
        cos = _C4 + z * (_C6 + z * (_C8 + z * (_C10 + z * (_C12 + z * _C14))))
        cos = 1.0 - 0.5 * z + z * z * cos
        half = math.floor(0.5 * k)
        odd = k - 2.0 * half  # 1 where sine and cosine change places
        sign = 1.0 - 2.0 * (half - 2.0 * math.floor(0.5 * half))
        s[COS * LANES + lane] = sign * ((1.0 - odd) * cos - odd * sin)
        s[SIN * LANES + lane] = sign * (odd * cos + (1.0 - odd) * sin)
        s[MOVED * LANES + lane] = 0.0


# rows of the workspace of a block: of the body at hand, then of a joint's unit twist at it
_R, _P, _W, _TURNING, _RISE = 0, 9, 12, 15, 18  # as in `crane_model.chain.dynamics`
_SPEED, _PUSH = 21, 24
_ALONG, _ABOUT = 27, 30
_TEN = 33
_ROWS = MOVED + 1


@njit(cache=True)
def _turns(chain: SerialChain) -> Array:
    """(3, m, 3, 3): R_i(q) is the first + cos(q) the second + sin(q) the third (Rodrigues)."""
    turns = np.zeros((3, *chain.rotation.shape))
    for i in range(len(chain.ratio)):
        for c in range(3):
            r, axis = row(chain.rotation[i], c), row(chain.axis, i)
            along, crossed = dot(r, axis), cross(r, axis)
            for d in range(3):
                if chain.slides[i]:
                    turns[0, i, c, d] = r[d]
                    continue
                turns[0, i, c, d] = along * axis[d]
                turns[1, i, c, d] = r[d] - along * axis[d]
                turns[2, i, c, d] = crossed[d]
    return turns


@njit(cache=True)
def _places(parameters: NDArray[np.int64], m: int) -> tuple[NDArray[np.uint64], NDArray[np.uint64]]:
    """Place of each of some parameters, rising, in the workspace when its body is at hand; those of
    body i are from number i of the second on.
    """
    places, begins = np.empty(len(parameters), np.uint64), np.zeros(m + 1, np.uint64)
    for c in range(len(parameters)):
        body, kind = divmod(parameters[c], 10)
        places[c] = (_TEN + kind) * LANES
        begins[body + 1 :] = c + 1
    return places, begins


@njit(cache=True)
def _at(s: Array, row: int, lane: int) -> Vector:
    """Three rows from `row` on."""
    i = row * LANES + lane
    return s[i], s[i + LANES], s[i + 2 * LANES]


@njit(cache=True)
def _put(s: Array, row: int, lane: int, a: Vector) -> None:
    i = row * LANES + lane
    s[i], s[i + LANES], s[i + 2 * LANES] = a


@njit(cache=True)
def _turned_back(s: Array, lane: int, a: Vector) -> Vector:
    """R^T a."""
    x, y, z = _at(s, _R, lane), _at(s, _R + 3, lane), _at(s, _R + 6, lane)  # rows of R
    return add(scaled(a[0], x), add(scaled(a[1], y), scaled(a[2], z)))


@njit(cache=True)
def _set_joint(
    chain: SerialChain,
    turns: Array,
    i: int,
    all_near: bool,
    q: Array,
    v: Array,
    a: Array,
    n: int,
    s: Array,
) -> None:
    """Rotation, origin, speed and push of joint i at the samples from n on, the last repeated."""
    j, ratio = chain.leader[i], chain.ratio[i]
    cos, sin, moved = COS * LANES, SIN * LANES, MOVED * LANES
    for lane in range(LANES):
        sample = min(n + lane, len(q) - 1)
        s[moved + lane] = ratio * q[sample, j]
        speed, push = ratio * v[sample, j], ratio * a[sample, j]
        for c in range(3):
            s[(_SPEED + c) * LANES + lane] = speed * chain.axis[i, c]
            s[(_PUSH + c) * LANES + lane] = push * chain.axis[i, c]
    if chain.slides[i]:
        for lane in range(LANES):
            s[cos + lane] = s[sin + lane] = 0.0
    elif all_near:
        set_near_turn(s)
    else:
        set_turn(s)
    for c in range(3):
        along = 0.0
        for d in range(3):
            along += chain.rotation[i, c, d] * chain.axis[i, d]
            fixed, even, odd = turns[0, i, c, d], turns[1, i, c, d], turns[2, i, c, d]
            first = (_R + 3 * c + d) * LANES
            for lane in range(LANES):
                s[first + lane] = fixed + s[cos + lane] * even + s[sin + lane] * odd
        first = (_P + c) * LANES
        for lane in range(LANES):
            s[first + lane] = chain.translation[i, c] + s[moved + lane] * along


@njit(cache=True, fastmath={"contract"})
def _move_on(s: Array, slides: bool) -> None:
    """Motion of the body before to that of the body at hand (Luh, Walker and Paul 1980)."""
    for lane in range(LANES):
        w, turning, rise = _at(s, _W, lane), _at(s, _TURNING, lane), _at(s, _RISE, lane)
        p, speed, push = _at(s, _P, lane), _at(s, _SPEED, lane), _at(s, _PUSH, lane)
        rise = add(rise, add(cross(turning, p), cross(w, cross(w, p))))
        w = _turned_back(s, lane, w)
        turning = _turned_back(s, lane, turning)
        rise = _turned_back(s, lane, rise)
        bent = cross(w, speed)
        if slides:
            rise = add(rise, add(push, scaled(2.0, bent)))
        else:
            turning = add(turning, add(push, bent))
            w = add(w, speed)
        _put(s, _W, lane, w)
        _put(s, _TURNING, lane, turning)
        _put(s, _RISE, lane, rise)


@njit(cache=True, fastmath={"contract"})
def _carry_twist(s: Array) -> None:
    """A joint's unit twist at the body before to that at the body at hand."""
    for lane in range(LANES):
        turn = _at(s, _ABOUT, lane)
        shift = add(_at(s, _ALONG, lane), cross(turn, _at(s, _P, lane)))
        _put(s, _ALONG, lane, _turned_back(s, lane, shift))
        _put(s, _ABOUT, lane, _turned_back(s, lane, turn))


@njit(cache=True, fastmath={"contract"})
def _set_power(s: Array) -> None:
    """Coefficients of the ten parameters of the body in the force of the joint with the unit twist.

    The force is m a + al x h + w x (w x h), the moment h x a + I al + w x I w (Newton, Euler).
    """
    for lane in range(LANES):
        w, al, rise = _at(s, _W, lane), _at(s, _TURNING, lane), _at(s, _RISE, lane)
        along, about = _at(s, _ALONG, lane), _at(s, _ABOUT, lane)
        moments = add(
            add(cross(along, al), scaled(dot(along, w), w)),
            add(scaled(-dot(w, w), along), cross(rise, about)),
        )
        b = cross(about, w)
        ten = _TEN * LANES + lane
        s[ten] = dot(along, rise)
        _put(s, _TEN + 1, lane, moments)
        s[ten + 4 * LANES] = about[0] * al[0] + b[0] * w[0]
        s[ten + 5 * LANES] = about[0] * al[1] + about[1] * al[0] + b[0] * w[1] + b[1] * w[0]
        s[ten + 6 * LANES] = about[1] * al[1] + b[1] * w[1]
        s[ten + 7 * LANES] = about[0] * al[2] + about[2] * al[0] + b[0] * w[2] + b[2] * w[0]
        s[ten + 8 * LANES] = about[1] * al[2] + about[2] * al[1] + b[1] * w[2] + b[2] * w[1]
        s[ten + 9 * LANES] = about[2] * al[2] + b[2] * w[2]


@njit(cache=True, inline="always")
def _add(
    s: Array,
    places: NDArray[np.uint64],
    begin: np.uint64,
    end: np.uint64,
    first: np.uint64,
    lanes: int,
    at: np.uint64,
    out: Array,
) -> None:
    """The columns from `begin` to `end` of row `at`, of `lanes` samples from the `first` on."""
    for c in range(begin, end):
        place = places[c]
        for lane in range(lanes):
            out[first + np.uint64(lane), at, c] += s[place + np.uint64(lane)]


@njit(cache=True)
def _fill_lanes(
    chain: SerialChain,
    rows: NDArray[np.int64],
    parameters: NDArray[np.int64],
    q: Array,
    v: Array,
    a: Array,
    out: Array,
) -> None:
    """Compiled `fill_regressor`. Unsigned numbers are no indices from the end, which is faster."""
    m = len(chain.ratio)
    all_near, turns, (places, begins) = near(chain, q), _turns(chain), _places(parameters, m)
    s, twists = np.empty(_ROWS * LANES), np.empty((m, 6 * LANES))
    twist, size = _ALONG * LANES, 6 * LANES  # where that of the joint at hand stands
    for n in range(0, len(q), LANES):
        first, lanes = np.uint64(n), min(LANES, len(q) - n)
        for c in range(3):
            for lane in range(LANES):
                s[(_W + c) * LANES + lane] = s[(_TURNING + c) * LANES + lane] = 0.0
                s[(_RISE + c) * LANES + lane] = -chain.gravity[c]
        for i in range(m):
            _set_joint(chain, turns, i, all_near, q, v, a, n, s)
            _move_on(s, chain.slides[i])
            for k in range(i + 1):
                if rows[k] < 0:
                    continue
                if k < i:
                    for e in range(size):
                        s[twist + e] = twists[k, e]
                    _carry_twist(s)
                else:
                    for c in range(3):
                        unit = chain.ratio[i] * chain.axis[i, c]
                        along, about = (unit, 0.0) if chain.slides[i] else (0.0, unit)
                        for lane in range(LANES):
                            s[(_ALONG + c) * LANES + lane] = along
                            s[(_ABOUT + c) * LANES + lane] = about
                for e in range(size):
                    twists[k, e] = s[twist + e]
                _set_power(s)
                at = np.uint64(rows[k])
                begin, end = begins[i], begins[i + 1]
                if lanes == LANES:  # a constant: the compiler unrolls it
                    _add(s, places, begin, end, first, LANES, at, out)
                else:
                    _add(s, places, begin, end, first, lanes, at, out)


PER_BODY = ("m", "mx", "my", "mz", "Ixx", "Ixy", "Iyy", "Ixz", "Iyz", "Izz")

TEN_FROM_PSEUDO_INERTIA = np.zeros((10, 4, 4))
"""(10, 4, 4): each of the ten is the sum over the products of its matrix with P, entry by entry."""
TEN_FROM_PSEUDO_INERTIA[[0, 1, 2, 3], [3, 0, 1, 2], [3, 3, 3, 3]] = 1.0
TEN_FROM_PSEUDO_INERTIA[[4, 4, 6, 6, 9, 9], [1, 2, 0, 2, 0, 1], [1, 2, 0, 2, 0, 1]] = 1.0
TEN_FROM_PSEUDO_INERTIA[[5, 7, 8], [0, 0, 1], [1, 2, 2]] = -1.0


def pseudo_inertia(ten: Array) -> Array:
    """Pseudo-inertias (..., 4, 4) [kg m2, kg m, kg] of bodies with the ten parameters (..., 10).

    A body with a mass, and with principal moments of inertia of which none exceeds the sum of the
    other two, has a positive definite one.

    >>> ball = np.array([2.0, 0.0, 0.0, 0.0, 0.8, 0.0, 0.8, 0.0, 0.0, 0.8])
    >>> np.linalg.eigvalsh(pseudo_inertia(ball)).round(3)
    array([0.4, 0.4, 0.4, 2. ])
    """
    ten = np.asarray(ten, dtype=float)
    inertia = ten[..., [[4, 5, 7], [5, 6, 8], [7, 8, 9]]]
    out: Array = np.empty((*ten.shape[:-1], 4, 4))
    half = 0.5 * np.trace(inertia, axis1=-2, axis2=-1)[..., np.newaxis, np.newaxis]
    out[..., :3, :3] = half * np.eye(3) - inertia
    out[..., :3, 3] = out[..., 3, :3] = ten[..., 1:4]
    out[..., 3, 3] = ten[..., 0]
    return out


def ten_about_centre(ten: Array) -> tuple[float, Array, Array]:
    """Mass [kg], centre of mass (3,) [m] and inertia (3, 3) about it [kg m2] of the ten (10,)."""
    mass, centre = float(ten[0]), ten[1:4] / ten[0]
    inertia = ten[[[4, 5, 7], [5, 6, 8], [7, 8, 9]]]
    about: Array = inertia - mass * (centre @ centre * np.eye(3) - np.outer(centre, centre))
    return mass, centre, about


def regressor(chain: SerialChain, q: Array, v: Array, acceleration: Array) -> Array:
    """Y: (n, j) motion to (n, j, 10 m)."""
    out = np.zeros((*q.shape, len(PER_BODY) * len(chain.ratio)))
    fill_regressor(chain, chain.leader, np.arange(out.shape[2]), q, v, acceleration, out)
    return out


def fill_regressor(
    chain: SerialChain,
    rows: NDArray[np.int64],
    parameters: NDArray[np.int64],
    q: Array,
    v: Array,
    acceleration: Array,
    out: Array,
) -> None:
    """Write columns of Y into `out` (n, rows, columns), which comes as zeros: of `parameters`, in
    rising order among the 10 m, side by side. Joint i of the chain is row `rows[i]`; negative, it
    is left out.
    """
    q, v, a = (np.ascontiguousarray(motion, dtype=float) for motion in (q, v, acceleration))
    _fill_lanes(chain, rows, parameters, q, v, a, out)
