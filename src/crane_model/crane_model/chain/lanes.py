"""The regressor of `crane_model.chain.ten_parameters`, eight samples at a time.

Every quantity of a block of samples is a row of LANES numbers, and what is computed of them stands
in loops over a row whose places are constants: so the compiler turns them into instructions on
several samples at once.
"""

import numpy as np
from numba import njit
from numpy.typing import NDArray

from crane_model.array import Array
from crane_model.chain.lane_angles import (
    COS,
    LANES,
    MOVED,
    SIN,
    near,
    set_near_turn,
    set_turn,
)
from crane_model.chain.serial_chain import SerialChain
from crane_model.chain.vectors import Vector, add, cross, dot, row, scaled

# rows of the workspace of a block: of the body at hand, then of a joint's unit twist at it; at the
# end stand those of `crane_model.chain.lane_angles`
_R, _P, _W, _TURNING, _RISE = 0, 9, 12, 15, 18  # as in `crane_model.chain.motion`
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
    """Where each of some parameters, rising, stands in the workspace when its body is at hand;
    those of body i are from number i of the second on.
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
    """What the ten parameters of the body ask of the joint with the unit twist.

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
def fill(
    chain: SerialChain,
    rows: NDArray[np.int64],
    parameters: NDArray[np.int64],
    q: Array,
    v: Array,
    a: Array,
    out: Array,
) -> None:
    """As `crane_model.chain.fill_regressor`. Whole numbers without a sign are no indices from the
    end, for which the compiler would have to look.
    """
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
