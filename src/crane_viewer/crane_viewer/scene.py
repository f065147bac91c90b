"""The crane in space: the URDF as it moves, its cylinders, its reach, and the path of its tip."""

import math
import tempfile
from collections import deque
from functools import cache
from pathlib import Path
from typing import NamedTuple

import numpy as np
import rerun as rr

from crane_model.actuators import CylinderActuator
from crane_model.inspection import PlacedBar, placed_bars, poses
from crane_model.kinematics import tip_position
from crane_model.machine import Machine
from crane_model.urdf import urdf
from crane_viewer import paths

BARREL = (38, 42, 48)
ROD = (206, 212, 219)
LINK = (104, 112, 122)
WALL_RATIO = 1.3  # of a barrel: radius outside over that of the piston
BARREL_SHARE = 0.92  # of the shortest length from pin to pin that the barrel takes
LINK_SHARE = 0.04  # of its length: radius of a link

REACH_POSES = 200_000
AT_A_LIMIT_SHARE = 1 / 3  # share of the joints of a pose: there, most of the boundary is reached
REACH_BANDS = 60  # of height, or of direction
REACH_SEED = 0

FRAME_PERIOD_NS = 50_000_000  # ns between two pictures: a browser shows no more, live
TRAIL_PICTURES = 400  # 20 s of where the tip was
REACH_COLOUR = (92, 140, 196, 150)
TRAIL_COLOUR = (224, 92, 40)
TIP_RADIUS_M = 0.035  # m
LINE_RADIUS = rr.Radius.ui_points(1.5)


class RoundBar(NamedTuple):
    """A straight round bar in the base's frame [m]."""

    begin: np.ndarray
    end: np.ndarray
    radius: float
    colour: tuple[int, int, int]


def round_bars(machine: Machine, q: np.ndarray) -> list[RoundBar]:
    """Barrels, rods and links at q (j,), always as many and in the same order."""
    return [part for bar in placed_bars(machine, q) for part in _parts(machine, bar)]


def _parts(machine: Machine, bar: PlacedBar) -> list[RoundBar]:
    length = float(np.linalg.norm(bar.end - bar.begin))
    actuator = machine.actuators[bar.joint]
    if not (bar.is_cylinder and isinstance(actuator, CylinderActuator)):
        return [RoundBar(bar.begin, bar.end, LINK_SHARE * length, LINK)]
    piston = math.sqrt(actuator.area_a_of_one / math.pi)
    rod = math.sqrt(max(actuator.area_a_of_one - actuator.area_b_of_one, 0.0) / math.pi)
    share = min(BARREL_SHARE * actuator.length_min / length, 1.0)
    mouth = bar.begin + share * (bar.end - bar.begin)
    return [
        RoundBar(bar.begin, mouth, WALL_RATIO * piston, BARREL),
        RoundBar(bar.begin, bar.end, rod or 0.5 * piston, ROD),
    ]


def along_z(begin: np.ndarray, end: np.ndarray) -> tuple[float, float, float, float]:
    """Quaternion (x, y, z, w) that turns the z axis to the direction from `begin` to `end`."""
    x, y, z = (end - begin) / np.linalg.norm(end - begin)
    if z < -1.0 + 1e-12:
        return 1.0, 0.0, 0.0, 0.0
    w = math.sqrt((1.0 + z) / 2.0)
    return -y / (2.0 * w), x / (2.0 * w), 0.0, w


@cache
def reached_places(machine: Machine) -> np.ndarray:
    """Sample where the tip can get.

    Parameters
    ----------
    machine
        Machine whose joints move within their limits.

    Returns
    -------
    ndarray, shape (n, 3)
        Places of the tip in the base's frame, many of them on the boundary [m].
    """
    generator = np.random.default_rng(REACH_SEED)
    low, _, high = poses(machine)
    q = generator.uniform(low, high, (REACH_POSES, len(low)))
    at_limit = generator.random(q.shape) < AT_A_LIMIT_SHARE
    limit = np.where(generator.random(q.shape) < 0.5, low, high)
    return tip_position(machine, np.where(at_limit, limit, q))


def side_outline(places: np.ndarray) -> np.ndarray:
    """Outline of places, seen along the ground.

    Parameters
    ----------
    places : ndarray, shape (n, 3)
        Places in the base's frame [m].

    Returns
    -------
    ndarray, shape (m, 2)
        Radius and height of a closed line [m].

    Examples
    --------
    >>> places = np.array([[1.0, 0.0, 0.0], [0.0, 3.0, 0.0], [2.0, 0.0, 1.0]])
    >>> side_outline(places)[:, 0].tolist()  # out along the outer side, back along the inner one
    [3.0, 2.0, 2.0, 1.0, 3.0]
    """
    radius, height = np.hypot(places[:, 0], places[:, 1]), places[:, 2]
    band = _bands(height, height.min(), height.max())
    present = np.unique(band)
    centre = height.min() + (present + 0.5) * (np.ptp(height) or 1.0) / REACH_BANDS
    inner = np.array([radius[band == band_number].min() for band_number in present])
    outer = np.array([radius[band == band_number].max() for band_number in present])
    out, back = np.stack([outer, centre], axis=1), np.stack([inner, centre], axis=1)[::-1]
    return np.concatenate([out, back, out[:1]])


def ground_arc(places: np.ndarray) -> np.ndarray:
    """Farthest places in every direction that is reached, seen from above.

    Parameters
    ----------
    places : ndarray, shape (n, 3)
        Places in the base's frame [m].

    Returns
    -------
    ndarray, shape (m, 2)
        Coordinates x and y of a line [m].
    """
    angle, radius = np.arctan2(places[:, 1], places[:, 0]), np.hypot(places[:, 0], places[:, 1])
    band = _bands(angle, -np.pi, np.pi)
    present = np.unique(band)
    centre = -np.pi + (present + 0.5) * 2.0 * np.pi / REACH_BANDS
    gap = int(np.argmax(np.diff(centre, append=centre[0] + 2.0 * np.pi))) + 1
    centre = np.roll(centre, -gap)  # the line begins where the widest gap ends
    farthest = np.array(
        [radius[band == band_number].max() for band_number in np.roll(present, -gap)]
    )
    return farthest[:, None] * np.stack([np.cos(centre), np.sin(centre)], axis=1)


def _bands(values: np.ndarray, low: float, high: float) -> np.ndarray:
    """(n,) whole numbers from 0 to `REACH_BANDS` - 1."""
    share = (values - low) / ((high - low) or 1.0)
    bands: np.ndarray = np.minimum((share * REACH_BANDS).astype(int), REACH_BANDS - 1)
    return bands


class Scene3D:
    """Logs pictures of a machine to a recording."""

    def __init__(self, recording: rr.RecordingStream, machine: Machine):
        self._recording, self._machine = recording, machine
        with tempfile.TemporaryDirectory() as folder:
            file = Path(folder, "machine.urdf")
            file.write_text(urdf(machine), encoding="utf-8")
            self._tree = rr.urdf.UrdfTree.from_file_path(file, entity_path_prefix=paths.ROBOT)
        moving = [self._tree.get_joint_by_name(joint.name) for joint in machine.joints]
        led = [machine.led_by(joint) for joint in machine.joints]
        self._joints = [
            (joint, *by) for joint, by in zip(moving, led, strict=True) if joint is not None
        ]
        places = reached_places(machine)
        self._outline, self._arc = side_outline(places), ground_arc(places)
        self._trail: deque[np.ndarray] = deque(maxlen=TRAIL_PICTURES)
        self._next = 0  # ns
        self._draw_what_stands()

    def _draw_what_stands(self) -> None:
        recording = self._recording
        self._tree.log_urdf_to_recording(recording)
        solid = rr.Boxes3D.from_fields(fill_mode="solid")
        for link in (paths.BASE_FRAME, *(joint.name for joint in self._machine.joints)):
            for path in self._tree.get_visual_geometry_paths(link):
                recording.log(path, solid, static=True)
        recording.log("/", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
        for path in (paths.CYLINDERS, paths.REACH, paths.TIP, paths.TRAIL):
            recording.log(path, rr.CoordinateFrame(paths.BASE_FRAME), static=True)

    @property
    def posed(self) -> bool:
        return bool(self._trail)

    def show(self, stamps: np.ndarray, positions: np.ndarray) -> None:
        """Pictures at stamps (n,) [ns] of the poses (n, j), as many as can be seen."""
        for stamp, q in zip(stamps.tolist(), positions, strict=True):
            backwards = stamp < self._next - 2 * FRAME_PERIOD_NS  # a bag that is played again
            if (stamp >= self._next or backwards) and np.isfinite(q).all():
                self._next = stamp + FRAME_PERIOD_NS
                self._draw(stamp, q)

    def _draw(self, stamp: int, q: np.ndarray) -> None:
        recording, machine = self._recording, self._machine
        recording.set_time(paths.TIMELINE, timestamp=np.datetime64(stamp, "ns"))
        for joint, leader, ratio in self._joints:
            value = float(ratio * q[leader])
            recording.log(
                f"{paths.JOINT_FRAMES}/{joint.name}", joint.compute_transform(value, False)
            )
        if bars := [bar for bar in round_bars(machine, q) if np.isfinite(bar.end).all()]:
            cylinders = rr.Cylinders3D(
                lengths=[float(np.linalg.norm(bar.end - bar.begin)) for bar in bars],
                radii=[bar.radius for bar in bars],
                centers=[(bar.begin + bar.end) / 2.0 for bar in bars],
                quaternions=[rr.Quaternion(xyzw=along_z(bar.begin, bar.end)) for bar in bars],
                colors=[bar.colour for bar in bars],
                fill_mode="solid",
            )
            recording.log(paths.CYLINDERS, cylinders)
        tip = tip_position(machine, q)[0]
        self._trail.append(tip)
        recording.log(paths.TIP, rr.Points3D([tip], radii=TIP_RADIUS_M, colors=TRAIL_COLOUR))
        trail = rr.LineStrips3D([list(self._trail)], radii=LINE_RADIUS, colors=TRAIL_COLOUR)
        recording.log(paths.TRAIL, trail)
        reach = [self._outline_towards(tip), np.insert(self._arc, 2, 0.0, axis=1)]
        recording.log(paths.REACH, rr.LineStrips3D(reach, radii=LINE_RADIUS, colors=REACH_COLOUR))

    def _outline_towards(self, tip: np.ndarray) -> np.ndarray:
        """(m, 3) what is reached in the upright plane of the tip."""
        distance = float(np.hypot(tip[0], tip[1]))
        ahead = tip[:2] / distance if distance > 1e-6 else np.array([1.0, 0.0])
        radius, height = self._outline.T
        return np.stack([radius * ahead[0], radius * ahead[1], height], axis=1)
