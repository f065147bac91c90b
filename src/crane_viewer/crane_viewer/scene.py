"""The crane in space: the URDF as it moves, its cylinders, its reach, and the way of its tip."""

import tempfile
from collections import deque
from pathlib import Path

import numpy as np
import rerun as rr

from crane_model.kinematics import tip_position
from crane_model.machine import Machine
from crane_model.urdf import urdf
from crane_viewer import paths
from crane_viewer.cylinders import along_z, round_bars
from crane_viewer.reach import ground_arc, reached_places, side_outline

FRAME_PERIOD_NS = 50_000_000  # ns between two pictures: a browser shows no more, live
TRAIL_PICTURES = 400  # 20 s of where the tip was
REACH_COLOUR = (92, 140, 196, 150)
TRAIL_COLOUR = (224, 92, 40)
TIP_RADIUS = 0.035  # m
LINE_RADIUS = rr.Radius.ui_points(1.5)


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
        self._joints = [(one, *by) for one, by in zip(moving, led, strict=True) if one is not None]
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
        """Whether a pose has been shown."""
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
        recording.log(paths.TIP, rr.Points3D([tip], radii=TIP_RADIUS, colors=TRAIL_COLOUR))
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
