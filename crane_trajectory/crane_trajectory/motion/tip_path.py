"""Paths of the tip, lines and arcs, planned as joint trajectories.

A path is a chain of segments in the base frame. Where two segments meet at an angle the tip stops;
elsewhere it goes on. All poses along the path are found together, by least squares: the tip is on
the path, the joints stay within their limits, and of the poses that are left, those are taken that
need the least flow (of a joint without cylinder: the least share of its speed) and bend the least.
The tip then follows the path with the speed and the acceleration that were asked for, or more
slowly if a limit of the machine would be passed.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from crane_model.cylinders import lever_arm
from crane_model.errors import RangeError
from crane_model.kinematics import tip_jacobian, tip_position
from crane_model.machine import Machine
from crane_trajectory.motion.check import pump_flow
from crane_trajectory.motion.motion import running_up
from crane_trajectory.motion.points import PointsTrajectory

if TYPE_CHECKING:
    from scipy.interpolate import CubicSpline

STEP = 0.04  # m, between two poses along the path
FEWEST_POSES, MOST_POSES = 12, 80  # of a piece between two stops
SHORTEST = 1e-3  # m: of a segment
STRAIGHT_ON = np.cos(np.radians(2.0))  # between the directions of two segments: no stop
OFF_PATH = 1e-3  # m, that the tip may be beside its path anywhere
RAMP = 1.5  # largest over mean acceleration of `running_up`
USED = 0.95  # of the speed limits and of the pump flow, at most
MARGIN = 2e-3  # of the range of a joint, that is kept at both ends; half of it at least
TOLERANCE = MARGIN / 2.0
DAMPING = 1e-6  # m2, of singular poses
BEYOND = 1e3  # weight of a range beyond the end of a range
BENDING = 0.1  # weight of a change of direction of the joints, against the way that they go
MOST_STEPS, LARGEST_STEP, SMALLEST_STEP = 100, 0.2, 1e-7  # of Gauss-Newton, in ranges
TIME_STEP = 0.02  # s, between two points of the joint trajectory ...
MOST_TIMES = 1000  # ... unless that makes more of them for a piece


class StraightLine(NamedTuple):
    """A straight line to a point (3,) [m] in the base frame."""

    end: np.ndarray


class Arc(NamedTuple):
    """A circular arc through a point (3,) to another one (3,) [m] in the base frame."""

    through: np.ndarray
    end: np.ndarray


Segment = StraightLine | Arc


@dataclass(frozen=True)
class TipPath:
    """A planned path of the tip."""

    trajectory: PointsTrajectory
    speed: float  # m/s, the highest that the tip reaches
    limited_by: str  # what made it slower than was asked for; empty if nothing did
    length: float  # m
    tip: np.ndarray  # (n, 3) m in the base frame: where it passes


class _Piece(NamedTuple):
    """A part of the path without a corner: points (n, 3) at arc lengths (n,) [m]."""

    length: np.ndarray
    point: np.ndarray


def plan_tip_path(
    machine: Machine,
    start: np.ndarray,
    segments: Sequence[Segment],
    speed: float,
    acceleration: float,
    name: str = "tip path",
) -> TipPath:
    """Plan the joint trajectory that takes the tip along `segments`, from rest to rest.

    It begins with the joints at `start` (j,) [rad, m]; `speed` and `acceleration` limit the tip
    along the path [m/s, m/s2]. `RangeError` if a segment has no length or an arc no circle, or if
    the tip cannot follow the path within the limits of the joints: it says how far it comes.
    """
    start = np.asarray(start, dtype=float)
    pieces = _pieces(tip_position(machine, start[np.newaxis])[0], segments)
    joints, times, tips = list(machine.joint_names), [np.zeros(1)], []
    motion = [np.stack([start, np.zeros_like(start), np.zeros_like(start)])[np.newaxis]]
    pose, begun, gone, fastest, limited = start, 0.0, 0.0, 0.0, ""
    for piece in pieces:
        poses = _poses(machine, pose, piece, gone)
        course = _spline(piece.length, poses)
        top, limits = _timed(machine, course, piece.length[-1], speed, acceleration)
        time, arc = _law(piece.length[-1], top, acceleration * (top / speed) ** 2)
        motion.append(_followed(course, arc)[1:])
        times.append(begun + time[1:])
        tips.append(tip_position(machine, course(arc[0])))
        pose, begun, gone = poses[-1], times[-1][-1], gone + piece.length[-1]
        fastest, limited = max(fastest, float(arc[1].max())), limited or limits
    position, velocity, rate = np.concatenate(motion).transpose(1, 0, 2)
    velocity[-1] = 0.0
    return TipPath(
        PointsTrajectory.of_arrays(name, joints, np.concatenate(times), position, velocity, rate),
        fastest,
        limited,
        gone,
        np.concatenate(tips),
    )


# Geometry.


def _pieces(start: np.ndarray, segments: Sequence[Segment]) -> list[_Piece]:
    """The path from `start` (3,), cut where it turns."""
    pieces: list[_Piece] = []
    last_direction: np.ndarray | None = None
    for number, segment in enumerate(segments, start=1):
        points = _sampled(start, segment, number)
        length = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1)))
        first = (points[1] - points[0]) / length[1]
        if last_direction is not None and first @ last_direction > STRAIGHT_ON:
            before = pieces.pop()
            points = np.concatenate([before.point, points[1:]])
            length = np.concatenate([before.length, before.length[-1] + length[1:]])
        pieces.append(_Piece(length, points))
        last_direction = (points[-1] - points[-2]) / (length[-1] - length[-2])
        start = points[-1]
    if not pieces:
        raise RangeError("tip path: no segment; give at least one point to go to")
    return [_thinned(piece) for piece in pieces]


def _thinned(piece: _Piece) -> _Piece:
    """As many points as its poses need, at equal distances."""
    count = int(np.clip(np.ceil(piece.length[-1] / STEP), FEWEST_POSES, MOST_POSES)) + 1
    length = np.linspace(0.0, piece.length[-1], count)
    return _Piece(length, _spline(piece.length, piece.point)(length))


def _spline(length: np.ndarray, points: np.ndarray) -> "CubicSpline":
    from scipy.interpolate import CubicSpline  # half a second to import

    return CubicSpline(length, points)


def _sampled(start: np.ndarray, segment: Segment, number: int) -> np.ndarray:
    """Points (n, 3) of a segment, its ends among them, at equal distances."""
    end = np.asarray(segment.end, dtype=float)
    if np.linalg.norm(end - start) < SHORTEST:
        raise RangeError(
            f"tip path: segment {number} ends {np.linalg.norm(end - start):.2g} m from where it "
            f"begins, at least {SHORTEST:g} m are needed; leave it out"
        )
    if isinstance(segment, StraightLine):
        return start + np.outer(np.linspace(0.0, 1.0, MOST_POSES), end - start)
    through = np.asarray(segment.through, dtype=float)
    a, b = through - start, end - start
    normal = np.cross(a, b)
    if np.linalg.norm(normal) < SHORTEST * np.linalg.norm(b):
        raise RangeError(
            f"tip path: segment {number}: its three points lie on a line, so no circle passes "
            "them; move the middle one, or go straight"
        )
    middle = start + np.cross((a @ a) * b - (b @ b) * a, normal) / (2.0 * (normal @ normal))
    x = (start - middle) / np.linalg.norm(start - middle)
    y = np.cross(normal / np.linalg.norm(normal), x)
    angle = np.mod(np.arctan2((end - middle) @ y, (end - middle) @ x), 2.0 * np.pi)
    turned = np.linspace(0.0, angle, MOST_POSES)
    radius = np.linalg.norm(start - middle)
    return middle + radius * (np.outer(np.cos(turned), x) + np.outer(np.sin(turned), y))


# Poses, as shares of the ranges of the joints.


def _poses(machine: Machine, start: np.ndarray, piece: _Piece, gone: float) -> np.ndarray:
    """(n, j) along the piece, the first of them `start` (j,) [rad, m]; `RangeError` if there are
    none.

    Gauss-Newton: each step brings the tip to its path and chooses, of the motions that leave it
    there, those that cost least.
    """
    low, high = _limits(machine)
    span = high - low
    if not ((start >= low) & (start <= high)).all():
        raise RangeError(
            f"tip path: {_at_ends(machine, start)} at the end of the range; move away from it first"
        )
    cost = _cost(machine, start)
    first = (start - low) / span
    share = np.tile(first, (len(piece.length) - 1, 1))
    for _ in range(MOST_STEPS):
        pose = low + span * share
        off = piece.point[1:] - tip_position(machine, pose)
        u, s, v = np.linalg.svd(tip_jacobian(machine, pose) * span)
        pull = s / (s**2 + DAMPING) * np.einsum("nij,ni->nj", u, off)
        there = share + np.einsum("nij,ni->nj", v[:, :3], pull)
        step = _cheapest(first, there, v[:, 3:], cost) - share
        largest = float(np.abs(step).max())
        share = share + step * min(1.0, LARGEST_STEP / max(largest, LARGEST_STEP))
        if largest < SMALLEST_STEP:
            break
    poses = np.vstack([start, low + span * share])
    off = np.linalg.norm(tip_position(machine, poses) - piece.point, axis=1)
    beyond = (share < -TOLERANCE) | (share > 1.0 + TOLERANCE)
    wrong = np.append(False, (off[1:] > OFF_PATH) | beyond.any(axis=1))
    if wrong.any():
        last = int(np.argmax(wrong)) - 1
        raise RangeError(
            f"tip path: the tip can follow it for {gone + piece.length[last]:.2f} m, then "
            f"{_at_ends(machine, poses[last + 1])} at the end of the range; choose points that are "
            "nearer, or begin from another pose"
        )
    return poses


def _cheapest(
    first: np.ndarray, there: np.ndarray, free: np.ndarray, cost: np.ndarray
) -> np.ndarray:
    """Poses (n, j) `there` moved along their `free` directions (n, f, j), where the tip stays: with
    the least `cost` (j,) of the ways from the `first` (j,) on, and within the ranges.
    """
    count, joints = there.shape
    own_moves = np.zeros((count, joints, count, free.shape[1]))
    own_moves[np.arange(count), :, np.arange(count)] = free.transpose(0, 2, 1)
    moves = own_moves.reshape(count, joints, -1)
    way = np.diff(there, axis=0, prepend=first[np.newaxis])
    move_way = np.diff(moves, axis=0, prepend=np.zeros((1, *moves.shape[1:])))
    beyond = there - np.clip(there, 0.0, 1.0)
    columns = np.concatenate(
        [
            (cost[:, np.newaxis] * move_way).reshape(count * joints, -1) * count**0.5,
            np.diff(move_way, axis=0).reshape((count - 1) * joints, -1) * BENDING * count**1.5,
            moves[beyond != 0.0] * BEYOND,
        ]
    )
    values = np.concatenate(
        [
            (cost * way).ravel() * count**0.5,
            np.diff(way, axis=0).ravel() * BENDING * count**1.5,
            beyond[beyond != 0.0] * BEYOND,
        ]
    )
    chosen = np.linalg.lstsq(columns, -values)[0]
    return np.asarray(there + moves @ chosen)


def _at_ends(machine: Machine, pose: np.ndarray) -> str:
    """The joints that are nearest to the ends of their ranges, in words."""
    low, high = _limits(machine)
    margin = np.minimum(pose - low, high - pose) / (high - low)
    near = np.flatnonzero(margin < max(float(margin.min()), 0.0) + TOLERANCE)
    return " and ".join(machine.joint_names[i] for i in near) + (
        " is" if len(near) == 1 else " are"
    )


def _limits(machine: Machine) -> tuple[np.ndarray, np.ndarray]:
    """(j,), (j,): lowest and highest positions of poses [rad, m]."""
    low, high, *_ = machine.ranges()
    return low + MARGIN * (high - low), high - MARGIN * (high - low)


def _cost(machine: Machine, pose: np.ndarray) -> np.ndarray:
    """(j,) what a way over the whole range of each joint costs; all together cost 1.

    The flow, as a share of the pump's, or for a joint without cylinder the time at full speed.
    """
    low, high = _limits(machine)
    cost = (high - low) / machine.ranges().top_speed
    if machine.supply:
        for i, joint in enumerate(machine.joint_names):
            if joint in machine.cylinders:
                area = machine.cylinders[joint].area_a
                arm = abs(float(lever_arm(machine, joint, pose[i : i + 1])[0]))
                cost[i] = area * arm * (high[i] - low[i]) / machine.supply.pump_flow
    return np.asarray(cost / cost.sum())


# Time.


def _law(length: float, speed: float, acceleration: float) -> tuple[np.ndarray, np.ndarray]:
    """Times (n,) and arc length, speed and acceleration (3, n), from rest to rest."""
    speed = min(speed, (length * acceleration / RAMP) ** 0.5)
    ramp = RAMP * speed / acceleration  # s
    duration = length / speed + ramp
    steps = np.clip(np.ceil(duration / TIME_STEP), FEWEST_POSES, MOST_TIMES)
    time = np.linspace(0.0, duration, int(steps) + 1)
    up, up_rate, up_change = running_up(time / ramp)
    down, down_rate, down_change = running_up((time - duration + ramp) / ramp)
    return time, np.stack(
        [
            np.minimum(speed * ramp * (up - down), length),
            speed * (up_rate - down_rate),
            speed * (up_change - down_change) / ramp,
        ]
    )


def _followed(course: "CubicSpline", arc: np.ndarray) -> np.ndarray:
    """(n, 3, j): position, velocity and acceleration of the joints at arc lengths (3, n)."""
    slope, bend = course(arc[0], 1), course(arc[0], 2)
    rate, change = arc[1][:, np.newaxis], arc[2][:, np.newaxis]
    return np.stack([course(arc[0]), slope * rate, bend * rate**2 + slope * change], axis=1)


def _timed(
    machine: Machine, course: "CubicSpline", length: float, speed: float, acceleration: float
) -> tuple[float, str]:
    """The speed of the tip that no limit forbids, at most `speed` [m/s], and what limits it."""
    _, arc = _law(length, speed, acceleration)
    position, velocity, _ = _followed(course, arc).transpose(1, 0, 2)
    used: dict[str, float] = {}
    for i, joint in enumerate(machine.joint_names):
        limit = machine.limits[joint]
        share = np.maximum(velocity[:, i] / limit.velocity_max, velocity[:, i] / limit.velocity_min)
        used[f"speed of {joint}"] = float(share.max())
    if machine.supply:
        flow = pump_flow(machine, machine.joint_names, position, velocity)
        used["pump flow"] = float(flow.max()) / machine.supply.pump_flow
    worst = max(used, key=lambda what: used[what])
    if used[worst] <= USED:
        return speed, ""
    return speed * USED / used[worst], worst
